"""Mathematics that knows of no arm. Imports nothing of this package but array types and errors."""
