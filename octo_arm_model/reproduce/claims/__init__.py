"""What the paper's text claims, and what each model says to it. Imports cases."""
