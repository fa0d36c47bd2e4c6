"""IR-SIM: robots in the plane, for navigation and learning."""

from __future__ import annotations

from usarsim_bench.peer import Peer

PEER = Peer(
    name="ir-sim",
    title="IR-SIM",
    home="https://ir-sim.readthedocs.io",
    packages=("ir-sim>=2.12,<3",),
    python=(10, 14),
    workload="irsim_rovers.py",
    against="rovers",
    same="The same hall seen from above, the same starts, the same wheel speeds commanded; a scan "
    "of 181 rays of 20 m from every rover ten times a second; all inside one process, without a "
    "window.",
    different="IR-SIM is a simulator of the plane: rovers are rectangles with the kinematics of a "
    "differential drive that step ten times a second, pushed apart where they overlap "
    "(collision_mode contact); there are no wheels, no heights, no dynamics. Compared are laser "
    "rays and robots moved per second, not physics. Our side also goes through the text protocol.",
)
