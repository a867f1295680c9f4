"""Recordings refined as one, against what is true of them."""
