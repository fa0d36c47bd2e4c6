"""Many runs: their folder, which goes on after an interruption, and who plays them: processes of
this machine, a Dask cluster, or SLURM. What a run is, its task says."""
