"""Tendons with friction in machine code, with and without loads. Imports the others."""
