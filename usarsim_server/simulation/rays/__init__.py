"""Rays against what stands and what moves."""
