"""Acceptance trials of the physics: manoeuvres with the bands of the reference, and their table."""
