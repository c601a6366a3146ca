"""The paper's models in machine code, where numba is installed. Imports what is below it."""
