"""Maximum-likelihood estimation of contact distance, force and friction, frame by frame, in compiled functions."""
