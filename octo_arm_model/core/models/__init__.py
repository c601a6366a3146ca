"""The models of the statics without loads. Imports section and what is below it."""
