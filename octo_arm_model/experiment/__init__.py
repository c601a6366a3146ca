"""Recorded experiments: the model compared with measured midlines, and fitted to them."""
