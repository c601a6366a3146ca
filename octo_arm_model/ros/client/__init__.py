"""Read what the node of an arm publishes, command its tendons, and give it another arm."""
