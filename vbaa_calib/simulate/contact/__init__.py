"""The antenna pressed against an object."""
