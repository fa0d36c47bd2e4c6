"""Cameras: what they see, where their tiles lie, who renders them."""
