"""Start node and simulator of an arm without hardware, and on request a node of the true shape."""

from launch.substitutions import LaunchConfiguration

from octo_arm_model.config.config import load_config
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.ros import launch_parts as parts
from octo_arm_model.simulation.movements import find_profile
from octo_arm_model.simulation.pushed_arm import touched
from octo_arm_model.simulation.simulator import for_arm_node, for_true_arm


def start(context):
    """Return all actions, for the values of the arguments in ``context``."""
    namespace, file = LaunchConfiguration('namespace'), parts.params_file(context)
    of_simulator, of_load_cells = [file], {}
    if simulator_file := parts.value_of('simulator_file', context):
        of_simulator.append(LaunchConfiguration('simulator_file'))
        of_load_cells = for_arm_node(load_parameters(simulator_file))
    common = parts.sim_time() | parts.overrides(context, 'base_frame')
    of_simulator.append(common)
    if movement := parts.value_of('profile', context):
        of_simulator.append({'profile.name': parts.text('profile'), 'profile.loop': True})
    program, of_arm, of_truth = 'octo_arm_node', of_load_cells, {}
    config = load_config(file)
    if parts.is_true('estimate', context):
        profile = find_profile(movement, config.arm) if movement else None
        of_sensors, of_estimator = touched(config, profile)
        of_simulator.append(of_sensors)
        of_truth = {'model': of_sensors['model']}
        program, of_arm = 'octo_arm_estimator', {**of_load_cells, **of_estimator}
    actions = [
        parts.arm_node(context, program, **of_arm),
        parts.node('octo_arm_sim', 'octo_arm_sim', namespace, *of_simulator),
        parts.rviz('octo_arm.rviz', parts.base_frame(context), namespace),
    ]
    if parts.is_true('ground_truth', context):
        # The prefix keeps these frames apart from those of the node and of other arms.
        prefix = parts.value_of('frame_prefix', context) or config.frame_prefix
        # True tensions are not readings of the load cells that the file may describe.
        truth = common | for_true_arm(config.arm) | of_truth
        truth['frame_prefix'] = f'{prefix}ground_truth_'
        name, true_namespace = 'octo_arm', [namespace, '/ground_truth']
        actions.append(parts.node('octo_arm_node', name, true_namespace, file, truth))
    return actions


def generate_launch_description():
    """Return the arguments and the function that starts everything by their values."""
    return parts.described(
        start,
        simulator_file={
            'default_value': '',
            'description': 'ROS parameter file of the simulator, such as config/simulator.yaml; '
            'empty for perfect winches and load cells',
        },
        profile={
            'default_value': '',
            'description': 'movement or file to play over and over; empty to wait for commands',
        },
        estimate={
            'default_value': 'false',
            'description': 'whether the arm is pushed again and again and measured with noise, '
            'and octo_arm_estimator runs in place of octo_arm_node',
        },
        ground_truth={
            'default_value': 'false',
            'description': 'whether another node publishes the shape that the simulated arm '
            'really has, in the namespace ground_truth, its frames with the prefix '
            'ground_truth_ after that of the arm',
        },
    )
