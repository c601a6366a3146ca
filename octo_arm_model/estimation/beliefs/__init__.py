"""Gaussian beliefs about a state, their mode and mean. Imports state and measurements."""
