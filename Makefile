# make run        an arm without hardware, shown at http://localhost:8080, its tendons in your hand;
#                 ARM=config/renda2012_table2.yaml chooses the arm, PORT=8081 the port
# make touch      the same arm, pushed again and again: from tensions, tip and markers with noise
#                 an estimator finds the force, and says how well it knows the shape
# make octopus    eight arms around a body, crawling
# make test       all tests; ARGS='-k name' passes options to pytest,
#                 NUMPY=1.26 SCIPY=1.11 tests on those versions
# make lint       style (ruff's and ROS's), types, and what may import what
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
export PYTHON
export OCTO_ARM_NUMPY := $(NUMPY)
export OCTO_ARM_SCIPY := $(SCIPY)

.PHONY: help run touch octopus test lint bench soak docs screenshots prepare clean

help:
	@sed -n 's/^# //p' $(firstword $(MAKEFILE_LIST))

run: prepare
	@tools/with_ros octo_arm_demo $(ARM) --port $(PORT)

touch: prepare
	@tools/with_ros octo_arm_demo $(ARM) --estimate --port $(PORT)

octopus: prepare
	@tools/with_ros octo_arm_octopus $(ARM) --port $(PORT)

test: prepare
	@tools/with_ros python -m pytest $(ARGS)

lint: prepare
	@tools/with_ros ruff check
	@tools/with_ros ruff format --check
	@tools/with_ros flake8 --config tools/ament_flake8.ini
	@tools/with_ros mypy
	@tools/with_ros lint-imports

bench: prepare
	@tools/with_ros python benchmarks/solvers.py
	@tools/with_ros python benchmarks/effects.py
	@tools/with_ros python benchmarks/node.py
	@tools/with_ros python benchmarks/floods.py
	@tools/with_ros python benchmarks/bags.py
	@tools/with_ros python benchmarks/viewer.py
	@tools/with_ros python benchmarks/estimation.py
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
