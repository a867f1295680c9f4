"""Results to look at: scenes, pages, object files and reports."""
