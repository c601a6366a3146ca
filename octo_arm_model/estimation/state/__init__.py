"""What is estimated, and the shape that follows from it."""
