"""The library ufbx (an optional package), which runs in a process of its own."""
