"""Geometry of an arm: meshes to draw, bases of an octopus, self-intersection.

May import config, rod and core; of analysis nothing but what is here.
"""
