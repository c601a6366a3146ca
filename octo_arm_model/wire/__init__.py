"""Messages as bytes, as tensions and as measurements.

May import analysis, estimation, config and arm; nothing of ROS.
"""
