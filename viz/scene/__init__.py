"""The scene of a result, as plain arrays."""
