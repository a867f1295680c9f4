"""Which picture or load to take next."""
