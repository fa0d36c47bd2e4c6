"""STA and BSTA of avatars (protocol reference 4.4 and 4.13)."""

from __future__ import annotations

import re
from dataclasses import replace

from usarsim_server.protocol.messages import AvatarStatus, avatar_bones, avatar_status

WORKER = AvatarStatus(
    time=12.3047,
    class_name="USARAvatarNewMale",
    name="Worker1",
    location=(2.0, 1.5, -0.98),
    orientation=(0.0, 0.0, 1.5708),
    walking=True,
)


def test_status() -> None:
    """The example of 4.4."""
    assert avatar_status(WORKER) == (
        "STA {Time 12.3047} {Type USARAvatarNewMale} {Name Worker1} {Location 2.00,1.50,-0.98} "
        "{Orientation 0.00,0.00,1.57} {Walking True}"
    )


def test_standing() -> None:
    """55: booleans are True and False."""
    assert avatar_status(replace(WORKER, walking=False)).endswith("{Walking False}")


def test_a_name_cannot_break_the_line() -> None:
    """Braces in a name do not open segments."""
    text = avatar_status(replace(WORKER, name="a} {Walking False"))
    assert re.fullmatch(r"STA( \{[^{}]*\}){6}", text)
    assert text.endswith("{Walking True}")


def test_bones() -> None:
    """4.13: a pair of Bone and Rotation for each, in the order given."""
    bones = [("LeftArm", (0.0, 0.25, 0.0)), ("RightArm", (0.0, -0.251, 0.0))]
    assert avatar_bones(3.05, "Worker1", bones) == (
        "BSTA {Time 3.0500} {Name Worker1} {Bone LeftArm} {Rotation 0.00,0.25,0.00} "
        "{Bone RightArm} {Rotation 0.00,-0.25,0.00}"
    )
