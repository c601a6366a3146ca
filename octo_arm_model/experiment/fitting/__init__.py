"""Parameters of an arm from measured midlines, by least squares, with confidence intervals.

May import recording and what is below it.
"""
