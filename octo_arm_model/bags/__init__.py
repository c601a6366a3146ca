"""Bags of experiments: their reading, their replay through the model, and simulated ones."""
