"""Linear algebra of the kernels: dense systems and products. Imports nothing of them."""
