"""Options that commands share.

May import what cli may; of the commands nothing.
"""
