"""What loads put on a rod: limits, resultants, tangents. Imports section and what is below."""
