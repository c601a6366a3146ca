"""The command line octo-arm: a file for each command, and the options that commands share.

May import every other package; ROS, rosbags and matplotlib only when a command needs them.
"""
