"""Recorded experiments: measured midlines compared with a model, and parameters fitted to them."""
