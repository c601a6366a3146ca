"""What is described: material, body, tendons and loads; errors, budgets and bounds of all input.

Imports nothing of the project.
"""
