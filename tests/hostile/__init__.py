"""Everything that clients can do to a server, and what well-behaved robots notice of it."""
