"""A match: a mission that is run with a team, from the first program to the archive."""
