"""Objects from strokes."""
