"""Detection of the antenna in front of a board."""
