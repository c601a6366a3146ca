"""A simulated experiment recorded as a bag.

May import the modules of bags beside it and what is below bags.
"""
