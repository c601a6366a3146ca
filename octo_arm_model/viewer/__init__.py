"""A page that shows an arm and commands its tendons, and the checks on requests to it."""
