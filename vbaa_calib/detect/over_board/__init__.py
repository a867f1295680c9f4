"""The antenna in front of a board."""
