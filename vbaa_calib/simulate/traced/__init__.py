"""Path-traced pictures of a simulated rig, by mitsuba 3."""
