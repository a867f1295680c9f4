"""Pictures to contacts."""
