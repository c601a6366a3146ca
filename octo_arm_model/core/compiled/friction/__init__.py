"""Kernels for tendons with friction, with and without loads. Imports the other kernels."""
