"""Things that clients put into a world."""
