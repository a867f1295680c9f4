"""Frames to contacts, with uncertainty and status."""
