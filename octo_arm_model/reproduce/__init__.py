"""The paper reproduced: its figures, tables and claims, computed anew, on one page."""
