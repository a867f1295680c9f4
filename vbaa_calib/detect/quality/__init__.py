"""Whether a picture of the board is good enough, and what to change."""
