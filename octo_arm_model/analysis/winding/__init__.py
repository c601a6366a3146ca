"""Tendons of prescribed displacement, as winches wind them: tensions, sensitivity, sequences.

May import config, rod and core; of analysis nothing but what is here.
"""
