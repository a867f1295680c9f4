"""Files of the reconstructed object: .vtp, .ply, .glb."""
