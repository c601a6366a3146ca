"""Messages as bytes, as tensions and as measurements.

May import analysis, estimation, config and core; nothing of ROS.
"""
