"""What people and hardware get wrong, drawn: what is reported of it, and what is wrong in silence."""
