"""Scenario files `usar-mission/1`: what they say, what of it cannot be, and the world they make.

The only part of missions that looks at worlds and robot classes of the server.
"""
