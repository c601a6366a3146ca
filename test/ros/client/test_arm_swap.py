"""The command load: another arm for a client node."""

import live_nodes
import pytest

from octo_arm_model import load_config
from octo_arm_model.cli.main import main
from octo_arm_model.config.paper_data import FETCHING_IN_PLANE
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.estimator.main import EstimatorNode


@pytest.fixture
def load(monkeypatch, capfd):
    """Runs `octo-arm load`; returns its status and what it wrote to stdout and stderr."""

    def run(client, *arguments):
        monkeypatch.setenv('ROS_DOMAIN_ID', str(client.domain))
        capfd.readouterr()
        with live_nodes.spinning(client):
            waiting = () if '--wait' in arguments else ('--wait', live_nodes.DEADLINE)
            status = main(['load', *map(str, (*waiting, *arguments))])
        said, complaints = capfd.readouterr()
        # The node logs here as well.
        own = [line for line in complaints.splitlines(True) if not line.startswith('[')]
        return status, said, ''.join(own)

    return run


def test_the_arm_of_a_running_node_is_exchanged_as_a_whole(client, load):
    before = client.dump()
    loads = {'loads__point_s': [0.1], 'loads__point_force': [0.0, 0.0, 0.01]}
    assert client.change(**loads, model='exact', stations=51) == (True, '')
    status, said, complaints = load(client, 'renda2012_table2')
    assert (status, complaints) == (0, '')
    assert '/octo_arm has the arm of' in said
    after = client.dump()
    # What the file does not name is as if it had never been set.
    assert after['loads.point_s'] == after['loads.point_force'] == []
    wanted = load_config(preset_path('renda2012_table2'))
    assert after['model'] == wanted.model
    assert after['sections.anchorage'] == [section.anchorage for section in wanted.arm.sections]
    status, _, complaints = load(client, live_nodes.CONFIG_FILE)
    assert (status, complaints) == (0, '')
    assert client.dump() == before
    answers = client.ask('tendon_tensions', FETCHING_IN_PLANE)
    live_nodes.assert_is_backbone(answers, FETCHING_IN_PLANE)


@pytest.mark.parametrize(
    ('old', 'new', 'complaint'),
    [
        ('length: 0.45', '', 'body.length is missing, expected double'),
        (
            'length: 0.45',
            'girth: 0.45',
            'body.girth is no parameter of arm, simulator or estimator; did',
        ),
        ('stations: 101', 'stations: 3', '/octo_arm stays as it is: stations is 3, expected'),
    ],
)
def test_a_file_that_is_no_arm_changes_nothing(client, load, tmp_path, old, new, complaint):
    before = client.dump()
    status, _, complaints = load(client, live_nodes.file_with(tmp_path, old, new))
    assert status == 2
    assert complaint in complaints
    assert complaints.count('\n') == 1
    assert client.dump() == before


@pytest.mark.parametrize(
    ('arguments', 'complaint'),
    [
        (('--node', '/nobody', '--wait', '0.1'), 'no node /nobody within 0.1 s'),
        (('--node', '/not a name'), "--node is '/not a name', expected the name of a node"),
        (('--wait', 'nan'), '--wait is nan'),
    ],
)
def test_a_node_that_has_no_arm_is_told(client, load, arguments, complaint):
    status, _, complaints = load(client, live_nodes.CONFIG_FILE, *arguments)
    assert status == 2
    assert complaint in complaints
    assert complaints.count('\n') == 1


def test_the_simulator_keeps_what_is_its_own(load):
    make_node, name = live_nodes.NODES['simulator']
    with live_nodes.hosting(make_node, '-p', 'winches.lag:=0.5', node=name) as simulator:
        simulator.dump()
        status, *_ = load(simulator, 'renda2012_prototype', '--node', '/octo_arm_sim')
        assert status == 0
        after = simulator.dump()
        assert after['winches.lag'] == 0.5
        assert after['sections.anchorage'] == [0.27]


def test_an_estimator_takes_what_is_its_own(load, tmp_path):
    given = tmp_path / 'arm.yaml'
    own = '    estimator: {force_stddev: 0.5}\n'
    given.write_text(preset_path('renda2012_prototype').read_text().rstrip() + '\n' + own)
    with live_nodes.hosting(EstimatorNode, node='octo_arm_estimator') as estimator:
        estimator.dump()
        status, *_ = load(estimator, given, '--node', '/octo_arm_estimator')
        assert status == 0
        after = estimator.dump()
        assert after['estimator.force_stddev'] == 0.5
        assert after['sections.anchorage'] == [0.27]
