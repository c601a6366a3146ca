"""Tendons of prescribed displacement, as winches wind them: tensions, sensitivity, sequences.

May import config, rod and arm; of analysis nothing but what is here.
"""
