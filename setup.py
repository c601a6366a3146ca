"""Install the Python package, which ROS finds through the ament index."""

from glob import glob

from setuptools import find_packages, setup

PACKAGE = 'octo_arm_model'

setup(
    name=PACKAGE,
    version='0.1.0',
    description='Shape of a tendon-driven soft arm from the tensions of its tendons.',
    license='Apache-2.0',
    maintainer='octo_arm_model maintainers',
    maintainer_email='unset@octo-arm-model.invalid',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    py_modules=['octo_arm_start'],
    package_data={PACKAGE: ['py.typed', 'ros/node/*.xml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/config', sorted(glob('config/*.yaml'))),
        (f'share/{PACKAGE}/config/ros2_control', sorted(glob('config/ros2_control/*.yaml'))),
        (f'share/{PACKAGE}/config/sros2', sorted(glob('config/sros2/*.xml'))),
        (f'share/{PACKAGE}/launch', sorted(glob('launch/*.launch.py'))),
        (f'share/{PACKAGE}/msg', sorted(glob('msg_defs/msg/*.msg'))),
        (f'share/{PACKAGE}/rviz', sorted(glob('rviz/*.rviz'))),
    ],
    python_requires='>=3.10',
    install_requires=['setuptools', 'numpy>=1.26', 'scipy>=1.11', 'pyyaml'],
    extras_require={
        # Parts of rosbags that may change parse definitions and profiles, and write bags.
        'bags': ['rosbags>=0.11.9,<0.12'],
        'cluster': ['distributed'],
        'compiled': ['numba'],
        'figures': ['matplotlib'],
        'gymnasium': ['gymnasium'],
        'test': [
            'gymnasium',
            'hypothesis',
            'matplotlib',
            'mcap',
            'mcap-ros2-support',
            'numba',
            'pillow',
            'pytest',
            'pytest-xdist',
            'selenium',
        ],
        'validation': ['scikit-fem'],
        'viewer': ['viser>=1.1', 'websockets>=14', 'msgspec'],
    },
    zip_safe=False,
    entry_points={
        'console_scripts': [
            'octo-arm = octo_arm_start:command_line',
            'octo_arm_demo = octo_arm_start:demo',
            'octo_arm_estimator = octo_arm_start:estimator',
            'octo_arm_lifecycle_estimator = octo_arm_start:lifecycle_estimator',
            'octo_arm_lifecycle_node = octo_arm_start:lifecycle_node',
            'octo_arm_node = octo_arm_start:node',
            'octo_arm_octopus = octo_arm_start:octopus',
            'octo_arm_sim = octo_arm_start:simulator',
            'octo_arm_viewer = octo_arm_start:viewer',
        ]
    },
)
