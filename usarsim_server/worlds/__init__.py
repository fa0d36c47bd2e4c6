"""Worlds: descriptions, world folders, scenery with victims, pictures."""
