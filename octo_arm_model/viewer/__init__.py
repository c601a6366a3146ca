"""The arm in a browser: what its node publishes, and a hand on its tendons."""
