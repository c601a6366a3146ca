"""Publishers of the node: backbone, strains, tip, tendons, frames and markers.

May import what is below the node; of the node nothing but what is here.
"""
