"""Linear algebra for the kernels: dense systems and products. Imports no other kernels."""
