"""Pictures, films and a live page of a run, all drawn from the same scenes."""
