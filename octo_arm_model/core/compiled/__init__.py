"""Models and loaded rods in machine code, where numba is installed. Imports what is below it.

In its folders are the kernels, in those of the core that they compute the same as.
"""
