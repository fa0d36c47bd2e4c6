"""Other simulators, one file each, with the programs that they run in `workloads/`."""
