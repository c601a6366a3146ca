"""The arm without hardware: what to pull, and what winches and load cells make of it."""
