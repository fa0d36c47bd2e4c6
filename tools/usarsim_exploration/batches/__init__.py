"""Batches of runs: read from a file, played on all cores, kept in a folder, and verified."""
