# make run        a simulated arm at http://localhost:8080, with a slider for each tendon;
#                 ARM=config/renda2012_table2.yaml chooses the arm, PORT=8081 the port
# make touch      the same arm, pushed again and again: from tensions, tip and markers with noise
#                 an estimator finds the force, and says how well it knows the shape
# make octopus    eight arms around a body, crawling
#                 all three move with their inertia in water, MOTION= without
# make test       what a change must pass; ARGS='-k name' passes options to pytest, -n 0 among
#                 them for one process, as a debugger needs
# make test-all   all tests, statistics and endurance too
# make test-oldest  what solves and fits on the oldest NumPy and SciPy: PYTHON=python3.12
# make lint       style (ruff's and ROS's), types, what may import what, and how large folders may be
# make bench      speed, as ratios
# make soak       the node under abuse for an hour; PART=0.01 for a minute
# make docs       the manual as web pages in docs/_build, warnings as errors
# make screenshots  the pictures of the viewer in docs/images; needs chromium and chromedriver
# make prepare    only what run and test need
# make clean      forget all that was prepared
PYTHON ?= python3
PART ?= 1.0
ARM ?= config/renda2012_table4.yaml
PORT ?= 8080
MOTION ?= --moving
export PYTHON
# Tests of a file run in one worker, which starts the nodes that they share once.
PYTEST = -m pytest -n 2 --dist loadfile --no-loadscope-reorder --durations 10 --durations-min 5
NUMERIC = test/arm test/rod test/truth test/analysis test/estimation test/experiment
OLDEST = .ros/oldest

.PHONY: help run touch octopus test test-all test-oldest lint bench soak docs screenshots prepare clean

help:
	@sed -n '/^# /!q; s/^# //p' $(firstword $(MAKEFILE_LIST))

run: prepare
	@tools/with_ros octo_arm_demo $(ARM) $(MOTION) --port $(PORT)

touch: prepare
	@tools/with_ros octo_arm_demo $(ARM) --estimate $(MOTION) --port $(PORT)

octopus: prepare
	@tools/with_ros octo_arm_octopus $(ARM) $(MOTION) --port $(PORT)

test: prepare
	@tools/with_ros python $(PYTEST) -m 'not endurance' $(ARGS)

test-all: prepare
	@tools/with_ros python $(PYTEST) $(ARGS)

# Without numba, which Ubuntu 24.04 does not have.
test-oldest: $(OLDEST)/installed
	@$(OLDEST)/bin/python $(PYTEST) -m 'not endurance' $(NUMERIC) $(ARGS)

$(OLDEST)/installed: tools/requirements-oldest.txt
	@echo preparing $(OLDEST), a minute
	@$(PYTHON) -m venv --clear $(OLDEST)
	@$(OLDEST)/bin/python -m pip install -q --disable-pip-version-check -r $<
	@touch .ros/COLCON_IGNORE $@

lint: prepare
	@tools/with_ros ruff check
	@tools/with_ros ruff format --check
	@tools/with_ros flake8 --config tools/ament_flake8.ini
	@tools/with_ros mypy
	@tools/with_ros lint-imports
	@tools/with_ros python tools/sizes.py

bench: prepare
	@tools/with_ros python benchmarks/solvers.py
	@tools/with_ros python benchmarks/effects.py
	@tools/with_ros python benchmarks/dynamics.py
	@tools/with_ros python benchmarks/node.py
	@tools/with_ros python benchmarks/floods.py
	@tools/with_ros python benchmarks/estimation.py
	@tools/with_ros python benchmarks/faults.py
	@tools/with_ros python benchmarks/estimator_node.py
	@tools/with_ros python benchmarks/octopus_estimation.py

soak: prepare
	@tools/with_ros python benchmarks/soak.py --part $(PART)

docs: prepare
	@tools/with_ros sphinx-build -q -W --keep-going -b html docs docs/_build
	@echo docs/_build/index.html

screenshots: prepare
	@tools/with_ros python docs/screenshots.py docs/images

prepare:
	@command -v $(PYTHON) >/dev/null || \
	  { echo "make: $(PYTHON) is missing: install python3 (3.10 to 3.13)" >&2; exit 1; }
	@$(PYTHON) tools/prepare.py

clean:
	rm -rf .ros
