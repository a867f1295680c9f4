"""Whatever comes from outside and is wrong, as rows of tables."""
