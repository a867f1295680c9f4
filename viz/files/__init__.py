"""The object as .vtp, .ply, .glb."""
