"""Models and loaded rods in machine code, where numba is installed. Imports what is below it.

The kernels are in folders named as those of the core whose formulas they evaluate.
"""
