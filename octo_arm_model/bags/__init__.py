"""Experiments recorded as bags: read, replayed through the model, simulated.

May import wire, analysis, estimation, config, rod and arm; needs rosbags, nothing of ROS.
"""
