"""Forward physics and pictures; nothing here knows the estimator or the camera layer."""
