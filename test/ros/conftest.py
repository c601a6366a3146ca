"""Nodes that tests share, and programs run within a test."""

import gc
import logging
import signal
from importlib.util import find_spec

import numpy as np
import pytest

from octo_arm_model import Config
from octo_arm_model.config.parameter_files import load_parameters, preset_path

# All of them need ROS 2 and the message package, see make test.
collect_ignore_glob = [] if find_spec('rclpy') and find_spec('octo_arm_msgs') else ['*']
LOADED = {
    'model': 'exact',
    'material.density': 1080.0,
    'material.youngs_modulus_stddev': 0.05,
    'loads.gravity': [0.0, 0.0, -9.81],
    'loads.fluid_density': 1000.0,
    'tension_stddev': 0.02,
}


@pytest.fixture
def context():
    """A context of rclpy in a domain of its own, for nodes within the test."""
    import rclpy
    from live_nodes import new_domain

    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=new_domain())
    yield context
    rclpy.shutdown(context=context)


@pytest.fixture
def make_node(context):
    """Makes nodes of the context, in an executor to be spun by the test; they end with it."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    executor, nodes = SingleThreadedExecutor(context=context), []

    def make(name, **options):
        nodes.append(rclpy.create_node(name, context=context, **options))
        executor.add_node(nodes[-1])
        return nodes[-1]

    yield make
    executor.shutdown()
    for node in nodes:
        node.destroy_node()


@pytest.fixture(scope='module')
def client():
    """Client of a node with the arm of table 4 and the model renda2012.

    What a test changes of the node it changes back.
    """
    from live_nodes import RELIABLE, hosting

    from octo_arm_model.ros.node.main import OctoArmNode

    with hosting(OctoArmNode, **RELIABLE) as client:
        client.connect()
        yield client


@pytest.fixture(scope='module')
def loaded():
    """Client of a node with a loaded arm of the model exact, its ``config`` and ``pull`` [N]."""
    from live_nodes import AFFORDED, RELIABLE, hosting

    from octo_arm_model.ros.node.main import OctoArmNode

    given = {'files': [preset_path('renda2012_prototype')], **RELIABLE, **AFFORDED, **LOADED}
    with hosting(OctoArmNode, node='loaded', **given) as client:
        client.config = Config.from_parameters(load_parameters('renda2012_prototype') | LOADED)
        client.names = list(client.config.arm.tendon_names)
        client.pull = np.array([[1.0, 0.3, 0.0, 0.0]])
        client.connect()
        yield client


@pytest.fixture
def run_here(monkeypatch, capfd):
    """Runs the ``main`` of a program of ROS in this process; returns what it wrote to stderr.

    Its signal handlers and the settings of its middleware do not outlive the test.
    """
    from live_nodes import new_domain

    numbers = signal.SIGINT, signal.SIGTERM, signal.SIGALRM
    before = [signal.getsignal(number) for number in numbers]
    handlers = logging.getLogger('octo_arm_model').handlers
    monkeypatch.setattr('octo_arm_model.ros.node.main.bound_memory', lambda: True)
    monkeypatch.setenv('ROS_DOMAIN_ID', str(new_domain()))

    def run(main, status, *arguments):
        capfd.readouterr()
        assert main(list(map(str, arguments))) == status
        return capfd.readouterr().err

    yield run
    gc.collect()  # the log of a node that could not be made, which would take that of the next
    logging.getLogger('octo_arm_model').handlers = handlers
    for number, handler in zip(numbers, before):
        signal.signal(number, handler)
