"""The antenna in a picture."""
