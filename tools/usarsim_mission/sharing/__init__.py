"""A run in one file that anybody can open: what is kept for it, and how it is packed."""
