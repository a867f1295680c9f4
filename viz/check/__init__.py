"""The report of `vbaa check`."""
