"""Nodes, clients and the player of profiles over ROS 2.

Imports rclpy and all packages below; the viewer and the apps alone import it in turn.
"""
