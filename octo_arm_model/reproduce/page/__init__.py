"""The page of the reproduction and how it is written. Imports claims and figures."""
