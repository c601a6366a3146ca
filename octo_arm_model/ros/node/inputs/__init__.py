"""Subscriptions of the node: tensions of every type, and the wrench on the tip.

Imports the prepared arm and diagnostics of the node, and what is below the node.
"""
