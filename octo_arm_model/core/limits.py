"""Bounds on the size of all input, in one table; each is checked where the input enters.

Time and memory of a solve grow in proportion to stations and to intervals times tendons. Within
these bounds every model takes at most some tens of seconds and a gigabyte.
"""

from __future__ import annotations

MAX_STATIONS = 10_000
MAX_INTERVALS = 20_000  # of the quadrature; see `grid`
MAX_SECTIONS = 64
MAX_TENDONS = 256
# A node of the grid at which a tendon is tabulated; there are two nodes to an interval.
MAX_TENDON_NODES = 500_000
MAX_POINT_LOADS = 256
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
