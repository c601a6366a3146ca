"""Kernels of cross sections: equilibrium, minimum of energy, sheaths. Imports numerics."""
