"""Messages as bytes, as tensions and as measurements."""
