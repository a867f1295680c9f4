"""Presentation of results: scenes, pages, object files and reports."""
