"""The description of an arm: material, body, tendons, loads; errors, budgets, bounds of input.

This folder imports no other folder of the project.
"""
