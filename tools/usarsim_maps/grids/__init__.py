"""Occupancy grids of ROS."""
