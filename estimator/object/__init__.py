"""Contacts to the object: what happened, surface, friction, stiffness."""
