"""What tests of programs need."""

from importlib.util import find_spec

# ROS 2 and the message package, see make test.
collect_ignore_glob = [] if find_spec('rclpy') and find_spec('octo_arm_msgs') else ['*']
