"""The arm as a sensor: shape, external force and their covariance from whatever is measured."""
