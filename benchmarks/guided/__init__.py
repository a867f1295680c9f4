"""Suggested pictures of the board."""
