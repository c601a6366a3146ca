"""The node of the simulator: commands in; what load cells, encoders and other sensors read out."""
