"""Description of an arm: material, body, tendons and loads. Imports numerics."""
