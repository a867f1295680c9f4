"""Diagnosis: hypotheses about mistakes of people and hardware, and one decision by evidence."""
