"""Pages from templates: style and script inside, every value escaped."""
