"""Commanded tensions over time, and winches, load cells and relaxation that act on them.

May import wire, analysis, estimation, config and arm; nothing of ROS.
"""
