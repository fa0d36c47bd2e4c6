"""Who drives: one session for each connection, its role and schedule, and their dispatcher."""
