"""A recording through an estimator: estimates, touches, a camera to compare with, tables.

Imports bags, simulation, wire, analysis, estimation, config, rod and arm.
"""
