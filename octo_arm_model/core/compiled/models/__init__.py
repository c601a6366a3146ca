"""Unloaded arms in machine code, by every model. Imports section and numerics."""
