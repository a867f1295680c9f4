"""Is a rig still right? New pictures against its predictions."""
