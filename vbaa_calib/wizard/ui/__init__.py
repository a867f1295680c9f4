"""Where a person meets the wizard."""
