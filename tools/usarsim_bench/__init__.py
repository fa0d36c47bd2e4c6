"""Measurements of a running server, taken from outside: speed, latency, spawning, memory.

Every figure is a ratio or a comparison taken within one run. The server is a process of its own;
the clients live in this one, so that their cost is not counted.
"""
