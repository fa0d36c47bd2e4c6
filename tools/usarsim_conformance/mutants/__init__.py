"""Small servers with a known fault each: what the checks of the kit are checked with."""
