"""Rigs drawn at random, photographed by a second renderer; whole calibrations and what they lead to."""
