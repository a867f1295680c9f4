"""Lenses from corners."""
