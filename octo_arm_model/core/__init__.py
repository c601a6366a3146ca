"""The solver: tensions in, backbone out. Imports numpy and scipy only."""
