"""The race: place and force of contacts by every method, on the same frames."""
