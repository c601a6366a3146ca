"""Experiments recorded as bags: read, replayed through the model, simulated."""
