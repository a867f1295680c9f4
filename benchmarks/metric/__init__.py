"""Pixels to rays."""
