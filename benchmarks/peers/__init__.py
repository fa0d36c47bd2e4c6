"""The same work done by other simulators; their programs are in `workloads/`."""
