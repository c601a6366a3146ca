"""The node of the simulator: commands in; what load cells, encoders and other sensors read out.

May import simulation, `ros.node` and the modules of ros beside it.
"""
