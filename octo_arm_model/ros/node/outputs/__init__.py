"""Publishers of the node: backbone, strains, tip, tendons, frames and markers.

Imports what is below the node.
"""
