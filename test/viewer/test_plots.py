"""The plots of the strains: curves of shapes that there are."""

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
viser = pytest.importorskip('viser', reason='needs viser')

from octo_arm_model import load_config
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.viewer.page import StrainPlots


def test_there_is_no_curve_before_there_is_a_shape():
    solver = load_config(preset_path('renda2012_prototype')).solver()
    server = viser.ViserServer('127.0.0.1', 0, verbose=False)
    try:
        plots = StrainPlots(server.gui, solver.grid.s)
        assert not any(plot.visible for plot in plots._plots)
        backbone = solver.solve([[1.0, 0.0, 0.0, 0.0]])
        plots.show(backbone, None)
        assert all(plot.visible for plot in plots._plots)
        _, _, curvature, _ = plots._plots
        for curve in curvature.data[1:]:
            np.testing.assert_array_equal(curve, backbone.k)
    finally:
        server.stop()
