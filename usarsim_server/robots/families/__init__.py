"""Families of vehicles: how a kind of machine takes DRIVE, and what its STA, CONF and GEO say."""
