"""Corners of printed boards and their covariance."""
