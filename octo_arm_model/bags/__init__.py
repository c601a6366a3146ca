"""Experiments recorded as bags: read, answered, compared with, made up. Needs rosbags, not ROS."""
