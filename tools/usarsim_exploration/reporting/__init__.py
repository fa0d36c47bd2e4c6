"""Reports over many runs: statistics, pictures, tables."""
