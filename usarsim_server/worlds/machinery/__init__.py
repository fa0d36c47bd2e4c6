"""Doors, lifts and obstacles of a world."""
