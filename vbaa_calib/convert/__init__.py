"""Other programs' camera files."""
