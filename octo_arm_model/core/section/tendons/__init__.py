"""Tendons in cross sections: sums over them, tables, tangents and lengths. Imports section."""
