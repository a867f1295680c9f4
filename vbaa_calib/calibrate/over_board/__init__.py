"""Plane C from the free antenna over a board."""
