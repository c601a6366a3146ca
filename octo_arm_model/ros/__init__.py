"""Nodes, clients and the player of profiles over ROS 2."""
