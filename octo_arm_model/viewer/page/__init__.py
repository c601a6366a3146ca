"""The contents of the page: scene, controls, plots and numbers.

Imports ros/client, analysis, simulation and all packages below.
"""
