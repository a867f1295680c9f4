"""What a simulated rig is made of: scene files, lens, objects."""
