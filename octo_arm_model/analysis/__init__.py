"""Analyses by a solver: inverse, arms driven by winches, workspace, geometry to draw."""
