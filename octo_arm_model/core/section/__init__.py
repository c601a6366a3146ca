"""One cross section: what its tendons sum to, its elastic energy and its balance. Imports rod."""
