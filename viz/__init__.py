"""What was found, shown: scenes, pages, object files and reports."""
