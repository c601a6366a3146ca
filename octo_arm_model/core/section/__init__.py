"""One cross section: sums over its tendons, elastic energy and equilibrium. Imports rod."""
