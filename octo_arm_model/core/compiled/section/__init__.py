"""Cross sections in machine code: balance, least energy, sheaths. Imports numerics."""
