"""Arguments of programs that are nodes of ROS; needs no ROS, so that --help does not either."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from octo_arm_model.terminal import make_parser

_DESCRIPTION = 'A node of ROS 2, until Ctrl-C. Its arguments are those of ROS, after --ros-args.'
_EPILOG = """\
example:
  {} --ros-args --params-file config/renda2012_table4.yaml
"""


def split_arguments(arguments: Sequence[str] | None) -> tuple[list[str], list[str]]:
    """Split ``arguments``, by default of the command line, at --ros-args: own, and of ROS."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    own = given.index('--ros-args') if '--ros-args' in given else len(given)
    return given[:own], given[own:]


def arguments_of_ros(name: str, arguments: Sequence[str] | None = None) -> list[str]:
    """Arguments of the node ``name`` from --ros-args on; of others --help alone is taken."""
    own, of_ros = split_arguments(arguments)
    make_parser(name, _DESCRIPTION, _EPILOG.format(name)).parse_args(own)
    return of_ros
