"""Tendons that dig into the body around them. Imports section."""
