"""Radio: who is where, what stands between two stations, how strong a signal arrives."""
