"""What commands print, and the files they write.

May import what cli may; of the commands and options nothing.
"""
