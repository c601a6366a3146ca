"""Rods under loads in machine code. Imports section and numerics."""
