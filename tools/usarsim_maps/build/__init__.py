"""A scene becomes a world folder: bodies, contact shapes, lamps, preview."""
