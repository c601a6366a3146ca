"""Tendons in compliant sheaths, displaced within the cross section. Imports section."""
