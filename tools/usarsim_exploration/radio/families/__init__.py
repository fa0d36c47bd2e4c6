"""Families of radio models, one file each; all files here are found by themselves."""
