"""The estimator's node: whatever is measured in; shape, contact and their covariances out.

Imports what the node of an arm does, estimation, and the modules of `ros.node`.
"""
