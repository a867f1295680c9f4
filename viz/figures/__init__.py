"""Figures of the reports: SVG inside a page."""
