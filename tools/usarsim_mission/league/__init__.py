"""A league: what many runs of several teams say about the teams."""
