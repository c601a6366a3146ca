"""Messages of backbones and estimates as bytes, and the reading of tensions and measurements."""
