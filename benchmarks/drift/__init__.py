"""Rigs that change between calibration and recording."""
