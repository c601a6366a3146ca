"""The program `octo_arm_viewer`."""

import sys
from collections.abc import Sequence

from octo_arm_model.ros.processes import split_arguments, stop_signals
from octo_arm_model.terminal import make_parser, status_of
from octo_arm_model.viewer.address import add_address, page_title

_PROG = 'octo_arm_viewer'
_EPILOG = """\
examples:
  octo_arm_viewer                      # the arm of the node in the root namespace
  octo_arm_viewer --namespace arm_3    # one arm of several
  octo_arm_viewer --host 0.0.0.0       # other machines can open the page too, and pull tendons
  octo_arm_viewer --host 0.0.0.0 --allow-origin http://arm.lab:8080   # and under this name

The page shows what the node publishes. It commands nothing until a slider or button is used.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve the page until a signal comes; return the exit status."""
    viewer_arguments, ros_arguments = split_arguments(arguments)
    parser = make_parser(_PROG, 'Show an arm in the browser and pull its tendons.', _EPILOG)
    parser.add_argument('--namespace', default='', help='namespace of the arm')
    add_address(parser)
    options = parser.parse_args(viewer_arguments)
    # These imports need ROS and viser, which --help does not.
    from octo_arm_model.ros.client.client import ArmClient
    from octo_arm_model.ros.start import client_node
    from octo_arm_model.viewer.page import Viewer
    from octo_arm_model.viewer.server import serving

    title, is_over = page_title(options.namespace.strip('/')), stop_signals()

    def show() -> int:
        with (
            client_node(_PROG, ros_arguments) as node,
            serving(options.host, options.port, options.allow_origin, title=title) as server,
        ):
            viewer = Viewer(server, ArmClient(node, options.namespace), title=title)
            while not is_over():
                viewer.step()
        return 0

    return status_of(_PROG, show)


if __name__ == '__main__':
    sys.exit(main())
