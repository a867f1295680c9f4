"""What people and hardware get wrong: hypotheses about what was reported, and one decision by evidence."""
