"""Commanded tensions over time, and winches, load cells and relaxation that act on them."""
