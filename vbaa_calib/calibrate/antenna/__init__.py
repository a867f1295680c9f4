"""Camera pose, antenna and moment sensor from pictures of the free and the loaded antenna."""
