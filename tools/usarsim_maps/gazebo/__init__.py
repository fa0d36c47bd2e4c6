"""Worlds and models of Gazebo (SDF)."""
