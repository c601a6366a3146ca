"""Commanded tensions over time: built-in movements, files, limits and pictures of them.

May import config and arm; of simulation nothing but what is here.
"""
