"""The ROS 2 side: everything here may import rclpy, elsewhere only the viewer does."""
