"""The model `exact` under loads: resultants, equilibrium, continuation. Imports models."""
