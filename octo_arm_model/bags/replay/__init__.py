"""The answers of the node to what a bag holds: solved, counted, and written as messages or CSV.

May import the modules of bags beside it and what is below bags.
"""
