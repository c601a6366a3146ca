"""Recorded experiments: measured midlines compared with a model, and parameters fitted to them.

May import reproduce, bags and what is below them; nothing of ROS.
"""
