"""Geometry of an arm: meshes to draw, bases of an octopus, self-intersection.

May import config, rod and arm; of analysis nothing but what is here.
"""
