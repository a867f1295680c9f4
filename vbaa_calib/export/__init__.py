"""The calibrated antenna, for other programs that simulate it."""
