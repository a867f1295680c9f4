"""Figures of the reports: matplotlib, as SVG inside a page."""
