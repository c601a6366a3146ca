"""The node of the simulator: commands in; readings of load cells, encoders and sensors out."""
