"""What a user waits for, beside an older commit and other programs."""
