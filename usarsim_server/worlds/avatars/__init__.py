"""People of a world that clients move."""
