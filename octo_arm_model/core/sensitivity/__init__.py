"""First derivatives of a solution. Imports loaded and what is below it."""
