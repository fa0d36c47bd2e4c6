"""pybullet: the Bullet physics engine for Python."""

from __future__ import annotations

from usarsim_bench.peer import Peer

PEER = Peer(
    name="pybullet",
    title="pybullet",
    home="https://pybullet.org",
    # Its wheels are built with NumPy but do not ask for it.
    packages=("pybullet>=3.2.5,<4", "numpy>=1.26"),
    # There are wheels of 3.2.7 for 3.10 and 3.11, none for 3.12 to 3.14.
    python=(10, 11),
    workload="pybullet_rovers.py",
    against="rovers",
    same="Rigid bodies in contact on both sides: rovers of four wheels, skid steered, with equal "
    "masses and wheels, in the same hall of boxes, with the same wheel speeds commanded; a scan "
    "of 181 rays (rayTestBatch, one thread) of 20 m from every rover ten times a second; all "
    "inside one process.",
    different="pybullet steps 240 times a second (its default), we step 250 times. Our side does "
    "more: commands and scans go through the text protocol, every robot has a battery, "
    "a status line, servos with limited acceleration and contact compensation. Not compared: how "
    "truly either of them moves, rendering, sockets.",
)
