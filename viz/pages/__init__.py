"""Pages from templates, with style and script inside and every value escaped."""
