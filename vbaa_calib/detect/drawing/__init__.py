"""Debug pictures."""
