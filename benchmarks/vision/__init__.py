"""The antenna in pictures."""
