"""Messages as bytes and as tensions, without ROS. Imports analysis and core."""
