"""Kernels of all models for unloaded arms. Imports section and numerics."""
