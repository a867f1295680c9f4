"""The exported antenna at rest in other simulators, beside our rod."""
