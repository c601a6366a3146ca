"""Programs of several nodes: what `make run` and `make octopus` start. Imports viewer and ros."""
