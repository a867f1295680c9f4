"""What every package uses: errors, files, tables, images, console, arrays."""
