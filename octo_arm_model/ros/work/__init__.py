"""What nodes compute, in turns and slices that requests and signals may come between.

May import rclpy alone.
"""
