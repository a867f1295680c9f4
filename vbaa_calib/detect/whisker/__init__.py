"""Detection of the antenna in a picture."""
