"""Recorded experiments: compare a model with measured midlines, and fit parameters to them."""
