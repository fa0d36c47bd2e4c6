"""What onlookers see of the live world, and what they may do to it (docs/scene-port.md)."""
