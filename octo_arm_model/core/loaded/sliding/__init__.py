"""Tendons that slide with friction. Imports section and what is below."""
