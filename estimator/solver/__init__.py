"""Maximum likelihood of contact distance, force and friction, many frames at once, in NumPy or torch."""
