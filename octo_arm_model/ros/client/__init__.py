"""Read what the node of an arm publishes, and publish commands for its tendons.

Imports the node's topics and QoS, config and simulation.
"""
