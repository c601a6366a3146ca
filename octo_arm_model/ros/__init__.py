"""The ROS 2 side: everything here may import rclpy, nothing else in the package does."""
