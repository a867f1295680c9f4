"""Every reader against files that were changed at random."""
