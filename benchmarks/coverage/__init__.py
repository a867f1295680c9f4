"""Predicted against sampled errors of calibrations."""
