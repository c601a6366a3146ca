"""``octo-arm load``: replace the arm of a running node by that of a file."""

import argparse

from octo_arm_model.arm.validation import positive
from octo_arm_model.cli import arguments
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter import refuse_unknown
from octo_arm_model.config.parameter_files import find_path, load_parameters, naming
from octo_arm_model.config.parameters import PARAMETERS
from octo_arm_model.estimation.settings import ESTIMATOR_PARAMETERS
from octo_arm_model.simulation.simulator import PARAMETERS as SIMULATOR_PARAMETERS

SUMMARY = 'replace the arm of a running node'
DESCRIPTION = """\
Replace the arm of a running node by that of CONFIG, between two messages. All parameters are set
together; if they do not describe an arm, none is set and the node's reason is printed. Parameters
of the arm that CONFIG does not name return to their defaults, also base_frame, base.position and
frame_prefix. Parameters of simulator and estimator do not change unless CONFIG names them.

`ros2 param load` sets the parameters of a file one by one instead. Each of them has to describe an
arm together with the present values of all others, so that some are set and some are refused.
"""
EPILOG = """\
examples:
  octo-arm load renda2012_table2
  octo-arm load my_arm.yaml --node /arm_3/octo_arm
  octo-arm load renda2012_table2 --node /octo_arm_sim     # the simulator pulls the same tendons

  ros2 param dump /octo_arm > kept.yaml                   # and, later, the same arm again:
  octo-arm load kept.yaml
"""
_OTHERS = (*SIMULATOR_PARAMETERS, *ESTIMATOR_PARAMETERS)


OPTIONS = f"""\
{arguments.CONFIG}
--node NAME = /octo_arm: the node, with its namespace
--wait S = 10.0: how long to wait for the node and for each answer [s]
"""


def run(options: argparse.Namespace) -> None:
    """Set all parameters of the node in one call."""
    positive('--wait', options.wait, 's')
    path = find_path(options.config)
    values = load_parameters(path)
    names = [parameter.name for parameter in PARAMETERS]
    with naming(path):
        known = [*names, *(parameter.name for parameter in _OTHERS)]
        refuse_unknown(values, known, 'arm, simulator or estimator')
        # A missing parameter is refused here, because the node would use its default.
        Config.from_parameters({name: v for name, v in values.items() if name in names})
    from octo_arm_model.ros.client.commands import swap_arm

    swap_arm(values, _OTHERS, options.node, options.wait)
    print(f'{options.node} has the arm of {path}')
