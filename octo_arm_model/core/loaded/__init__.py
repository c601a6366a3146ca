"""A rod under loads: resultants, equilibrium, continuation. Imports section and what is below."""
