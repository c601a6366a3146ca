"""Analyses with a solver: inverse, displacements of winches, workspace, geometry to draw."""
