"""The node of an arm: subscriptions, publishers, services and diagnostics around a solver.

Imports arm, config, analysis, wire and the modules of ros beside it.
"""
