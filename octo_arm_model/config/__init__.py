"""An arm from a parameter file: the one table of parameters and what they mean. Imports core."""
