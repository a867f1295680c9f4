"""Camera intrinsics from views of the board."""
