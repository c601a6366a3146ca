"""Parameters of an arm from measured midlines, by least squares, with confidence intervals.

May import shapes, recording and what is below them.
"""
