"""The error budget of a rig."""
