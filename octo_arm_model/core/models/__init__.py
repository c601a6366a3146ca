"""Models of the statics, by name in `catalogue`. Imports sensitivity and what is below it."""
