"""Mathematics without an arm. Imports nothing of this package but array types and errors."""
