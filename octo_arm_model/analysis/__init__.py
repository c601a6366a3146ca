"""Asked of a solver: inverse, displacements, workspace, meshes. Imports config and core."""
