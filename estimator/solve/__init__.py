"""Many frames at once: maximum likelihood of contact distance, force and friction, in NumPy or torch."""
