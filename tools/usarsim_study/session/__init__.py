"""A session of a study: what a participant does next, and the desk that says so to their pages."""
