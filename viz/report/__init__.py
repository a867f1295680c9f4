"""The report of a recording."""
