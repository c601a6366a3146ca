"""The unknowns of a fit: what can be fitted, the arm for their values, what they leave open.

May import what fitting may; of fitting nothing but what is here.
"""
