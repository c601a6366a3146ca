"""From a recording to one mean midline for each steady step of the tensions.

May import recording and what is below it; not fitting.
"""
