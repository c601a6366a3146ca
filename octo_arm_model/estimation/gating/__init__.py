"""Which measurements are used. Imports beliefs and what is below."""
