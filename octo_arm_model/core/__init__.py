"""What is solved: an arm and its loads, numerics, errors, bounds. Imports numpy and scipy only."""
