"""The reading of a robot file, part by part."""
