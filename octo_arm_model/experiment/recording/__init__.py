"""From a bag to one mean midline for each steady step of the tensions.

May import bags and what is below it; not fitting.
"""
