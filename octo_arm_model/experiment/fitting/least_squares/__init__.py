"""Least squares of an arm against measured shapes: pairs of points, residuals, the minimum.

May import unknowns and what is below fitting.
"""
