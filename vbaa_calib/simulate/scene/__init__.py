"""The parts of a simulated rig: scene files, lens, objects."""
