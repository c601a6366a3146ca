"""The estimator's node: whatever is measured in; shape, contact and their covariances out."""
