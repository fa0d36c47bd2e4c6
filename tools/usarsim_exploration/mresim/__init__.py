"""Files of MRESim: teams, settings and batches, read as scenarios (exploration reference 3)."""
