"""What happens in a session, before the first picture."""
