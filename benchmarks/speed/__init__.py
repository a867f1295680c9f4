"""This library's speed beside that of an older commit, on frames as users have them."""
