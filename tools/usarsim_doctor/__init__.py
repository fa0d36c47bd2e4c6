"""Whether this machine can run the server well, and what to do where it cannot.

`checks/` holds one file per subject; a function that is entered with `@check` is run, no list has
to be kept. What could end a process is tried in another one (`isolation.py`).
"""
