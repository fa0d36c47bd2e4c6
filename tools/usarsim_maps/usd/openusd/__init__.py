"""Stages through Pixar's library (`pxr`, the optional package usd-core): all in here import it."""
