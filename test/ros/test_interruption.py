"""A signal ends a node in the middle of a solve, however long that would take."""

import subprocess
import sys

import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from live_nodes import CONFIG, CONFIG_FILE, NodeClient, check_end, environment, new_domain
from octo_arm_msgs.srv import FindTensions

from octo_arm_model.ros.work import until_shutdown

# The solver sends the signal itself and then never returns.
PROGRAM = """
import os, signal, sys, time
from octo_arm_model.rod.solver import Solver
from octo_arm_model.ros.node import arm_server as services
from octo_arm_model.ros.node import main as node
def endless(*given, **named):
    os.kill(os.getpid(), signal.{signal})
    time.sleep(1000)
{patch} = endless
sys.exit(node.main(['--ros-args', '--params-file', {config!r}]))
"""
PATCHES = {
    'start': 'Solver.solve',
    'tensions': 'Solver.follow',
    'service': 'services.find_tensions',
}

# What comes while LLVM calls back is lost there, but not what comes of it.
COMPILING = """
import ctypes, os, signal, sys, time
from types import SimpleNamespace
from llvmlite.binding.executionengine import ExecutionEngine
from octo_arm_model.rod.solver import Solver
from octo_arm_model.ros.node import main as node
seen = []
def keep(module, code):
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(0.05)
    seen.append(code)
engine = SimpleNamespace(_object_cache_notify=keep, _find_module_ptr=lambda pointer: engine)
code = ctypes.create_string_buffer(b'code')
given = SimpleNamespace(module_ptr=1, buf_ptr=ctypes.addressof(code), buf_len=4)
data = SimpleNamespace(contents=given)
@ctypes.CFUNCTYPE(None)
def compiled():
    ExecutionEngine._raw_object_cache_notify(engine, data)
def endless(*given, **named):
    compiled()
    time.sleep(1000)
Solver.solve = endless
status = node.main(['--ros-args', '--params-file', {config!r}])
assert seen == [b'code'], 'what LLVM said was lost'
sys.exit(status)
"""


def started(program, domain):
    return subprocess.Popen(
        [sys.executable, '-c', program], env=environment(domain),
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def test_a_signal_ends_a_node_that_compiles_and_nothing_of_it_is_lost():
    pytest.importorskip('llvmlite', reason='needs numba')
    process = started(COMPILING.format(config=str(CONFIG_FILE)), new_domain())
    try:
        complaints = check_end(process, 0)
    finally:
        process.kill()
        process.communicate()
    assert 'xception' not in complaints, complaints


@pytest.mark.parametrize(
    ('what', 'name'), [('start', 'SIGINT'), ('tensions', 'SIGTERM'), ('service', 'SIGINT')]
)
def test_a_signal_ends_the_node_in_the_middle_of_a_solve(what, name):
    domain = new_domain()
    program = PROGRAM.format(patch=PATCHES[what], signal=name, config=str(CONFIG_FILE))
    process = started(program, domain)
    client = NodeClient(domain)
    service = client.node.create_client(FindTensions, 'find_tensions')

    def has_ended():
        if what == 'tensions':
            client.send('tendon_tensions', CONFIG.solver().rest_lengths)
        elif what == 'service' and service.service_is_ready():
            service.call_async(FindTensions.Request())
        return process.poll() is not None

    try:
        client.wait(has_ended, 'the end of the node')
        complaints = check_end(process, 0)
        assert 'xception' not in complaints, complaints
    finally:
        client.close()
        process.kill()
        process.communicate()


def test_what_fails_because_the_context_has_ended_is_no_error():
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    with pytest.raises(RuntimeError), until_shutdown(context):
        raise RuntimeError('of its own')
    with until_shutdown(context):
        rclpy.shutdown(context=context)
        raise RuntimeError('publisher of a context that is no more')
