"""Whether a rig is valid: new pictures against its predictions."""
