"""An arm from a parameter file: the table of parameters, the YAML reader, presets, paper data."""
