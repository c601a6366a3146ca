"""Recordings read from bags and CSV files: tensions, encoder readings and measured points.

May import bags and what is below it; nothing beside it in experiment.
"""
