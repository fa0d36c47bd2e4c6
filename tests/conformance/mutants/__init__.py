"""Proxies that make one fault each of a healthy server: what checks are checked with."""
