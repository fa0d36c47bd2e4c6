"""Operators made by code: they look, choose, drive and mark as a person would, by real pages."""
