"""What is described: material, body, tendons and loads of an arm. Imports numerics."""
