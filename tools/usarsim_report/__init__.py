"""What shows results to people: films, and pages that a program of this machine serves."""
