"""The geometry of the scene."""

import numpy as np
import pytest
from checkout import PRESETS

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
pytest.importorskip('viser', reason='needs viser')


from octo_arm_model import load_config
from octo_arm_model.analysis.drawing import Drawing
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.simulation.profiles.limits import highest_tensions
from octo_arm_model.viewer.scene import ArmScene, _unit_disc


@pytest.mark.parametrize('name', PRESETS)
def test_the_scene_has_the_geometry_of_the_drawing(server, name):
    config = load_config(preset_path(name))
    solver = config.solver('exact')
    arm = ArmScene(server.scene, name, solver)
    highest = highest_tensions(config.arm)
    for part in (0.0, 0.3):
        tensions = np.zeros(highest.size)
        tensions[0] = part * highest[0]
        backbone = solver.solve(tensions.reshape(config.arm.tension_shape))
        arm.show(backbone, tensions / highest)
        drawn = Drawing(config.arm, solver.grid.s, widen=solver.law.widens, sides=24).draw(
            backbone.position, backbone.quaternion, backbone.q
        )
        body = server.scene.get_handle_by_name(f'/{name}/body')
        np.testing.assert_allclose(body.vertices, drawn.vertices, atol=1e-7)
        assert body.faces.max() < len(body.vertices)
        lines = server.scene.get_handle_by_name(f'/{name}/tendons')
        assert len(lines.points) == sum(len(path) - 1 for path in drawn.tendons)
        # The one that is pulled is the reddest, as are all its segments.
        first = len(drawn.tendons[0]) - 1
        red = lines.colors[:, 0, 0].astype(int) - lines.colors[:, 0, 1]
        assert (red[:first] > 0).all() == (part > 0.0)
        assert (red[first:] == 0).all()
        # Rims of discs are where they belong: in the plane of an anchorage, at its radius.
        discs = server.scene.get_handle_by_name(f'/{name}/discs').vertices
        each = discs.reshape(len(config.arm.sections), -1, 3)
        for vertices, centre, radius in zip(each, drawn.disc_position, drawn.disc_radius):
            away = np.linalg.norm(vertices[:-2] - centre, axis=1)
            half = 0.002 * config.arm.length
            np.testing.assert_allclose(away, np.hypot(radius, half), rtol=1e-4)


def test_a_disc_is_closed_and_faces_outwards():
    vertices, triangles = _unit_disc(0.2)
    first, second, third = vertices.T[triangles].transpose(1, 0, 2)
    volume = np.einsum('ti,ti->', first, np.cross(second, third)) / 6.0
    assert volume == pytest.approx(0.2 * 12.0 * np.sin(np.pi / 12.0), rel=1e-12)
    edges = {(a, b) for row in triangles.tolist() for a, b in zip(row, row[1:] + row[:1])}
    assert len(edges) == 3 * len(triangles)
    assert all((b, a) in edges for a, b in edges)
