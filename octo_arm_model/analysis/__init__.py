"""Analyses with a solver: inverse, displacements of winches, workspace, geometry to draw.

May import config, rod and arm.
"""
