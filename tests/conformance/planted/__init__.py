"""Faults planted in our own server, one at a time, and whether the kit notices them.

    make planted                                    # all of them, one for each processor at a time
    make planted ARGS="'sensors.gps.*'"             # by name, as --only does for checks
    make planted ARGS=--list                        # what there is

A fault is one edit of one file of the server: a field, a scale or a sign. A copy of the server with
that edit is started as a process of its own, runs as fast as the machine goes, and is judged by
the checks that the fault names, with a robot of the class that it names. It is noticed if each of
these checks fails, and says which field is wrong. The same checks have to pass at the server as it
is. A fault is written in a file `*.diff` of this folder, and nowhere else:

    --- usarsim_server/sensors/gps.py

    @@ sensors.gps.north-halved @@ robot=P3AT dialect=udk
     control.values.gps-moves: Latitude
    -METRES_PER_DEGREE_NORTH = 111_200.0
    +METRES_PER_DEGREE_NORTH = 222_400.0

The file stands above all faults of it. Below a fault's name stand the checks, with commas between
them, that have to notice, and a pattern that their messages fit, the name of the wrong field. Robot
(P2AT) and dialect (ut2004; `any` for all that the server speaks) may be left out. The text behind -
has to stand exactly once in the file, the text behind + takes its place; more such pairs are
further edits.

Code has to mean something else afterwards: tests say so at once when the server has been rewritten
around a fault. Robot and world files (`robots/P2AT.toml`, `worlds/empty/world.toml`) can be edited
as well. These files look like differences, so that editors colour them; `patch` cannot read them.
"""

from planted.faults import Fault, all_faults, read_faults

__all__ = ["Fault", "all_faults", "read_faults"]
