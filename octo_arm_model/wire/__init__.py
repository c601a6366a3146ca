"""Messages as bytes and as tensions.

May import analysis, config and core; nothing of ROS.
"""
