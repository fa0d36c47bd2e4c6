"""What writes results for people: films."""
