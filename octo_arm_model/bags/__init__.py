"""Experiments recorded as bags: read, replayed through the model, simulated.

May import simulation, wire, analysis, config and core; needs rosbags, nothing of ROS.
"""
