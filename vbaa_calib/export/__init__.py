"""The antenna as calibrated, for other programs that simulate it."""
