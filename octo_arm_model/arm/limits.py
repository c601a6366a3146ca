"""Bounds on the size of all input, in one table; each is checked where the input enters.

Time and memory of a solve grow in proportion to stations and to nodes times tendons, under loads
with the third and second power of the nodes. Within these bounds every model takes at most some
tens of seconds and some gigabytes.
"""

from __future__ import annotations

MAX_STATIONS = 10_000
MAX_INTERVALS = 20_000  # that an arm could be cut into, each no longer than thick
MAX_NODES = 2_000  # of a loaded arm
MAX_SECTIONS = 64
MAX_TENDONS = 256
MAX_DISCS = 256
MAX_POINT_LOADS = 256
MAX_OBSTACLES = 32
MAX_TABLE_POINTS = 1_000  # of each table along s: radius, modulus, path, distributed force
MAX_TENDON_TABLE = 20_000  # values of a table of paths, over all tendons
MAX_FRICTION = 10.0  # Coulomb's coefficient; rubber on rubber has some 3
MAX_NAME = 255  # characters of a frame, a tendon or a path

MAX_SAMPLES = 2**20  # sets of tensions of a workspace
MAX_SAMPLED_TENSIONS = 2**25  # the same, times the tendons
MAX_PROCESSES = 1_000
MIN_RATE = 1e-6  # [Hz] of what is not off: ROS counts the period in nanoseconds of 64 bits

MAX_PROFILE_ROWS = 100_000
MAX_PROFILE_BYTES = 64 * 2**20  # of a CSV file

# Of a CSV file of a laboratory.
MAX_CSV_BYTES = 256 * 2**20
MAX_CSV_ROWS = 1_000_000
MAX_CSV_COLUMNS = 4_000

# Of a YAML file. Collections in collections are counted with aliases written out.
MAX_YAML_BYTES = 2**20
MAX_YAML_VALUES = 100_000
MAX_YAML_DEPTH = 20
