"""Common parts of every package: errors, files, tables, images, console, arrays."""
