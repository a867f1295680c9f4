"""Diagnoses of typed values, pictures and hardware."""
