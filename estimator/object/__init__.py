"""From contacts to the object: events, surface, friction, stiffness."""
