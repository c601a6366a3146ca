"""Models and loaded rods in machine code, where numba is installed. Imports what is below it."""
