"""What an arm publishes, as whoever watches sees it. Imports ros/messages."""
