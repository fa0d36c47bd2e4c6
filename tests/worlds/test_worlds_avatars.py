"""Classes of avatars, their file, their bodies."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from usarsim_server.data import data_directory
from usarsim_server.errors import WorldError
from usarsim_server.worlds.avatars.bodies import (
    ADULT,
    LIMBS,
    PELVIS,
    AvatarClass,
    avatar_model,
    joint_of,
    load_avatars,
)

SHIPPED = load_avatars([data_directory("worlds") / "avatars.toml"])


@pytest.mark.parametrize("name", ["USARAvatarNewMale", "USARAvatarFemale", "worker"])
def test_the_usual_classes_are_shipped(name: str) -> None:
    """What clients ask for is there, in any case, and is of human size."""
    found = SHIPPED[name.lower()]
    assert 1.5 < found.height < 2.0
    assert 0.5 < found.walk_speed < found.run_speed < 8.0


def test_a_name_is_enough(tmp_path: Path) -> None:
    """All other keys have defaults; aliases lead to the class."""
    sheet = tmp_path / "avatars.toml"
    sheet.write_text('[[avatar]]\nname = "Guard"\naliases = ["Sentry"]\n', encoding="utf-8")
    found = load_avatars([sheet, tmp_path / "missing.toml"])
    assert found["sentry"] is found["guard"]
    assert found["guard"] == AvatarClass("Guard", aliases=("Sentry",))


def test_a_world_may_replace_a_class(tmp_path: Path) -> None:
    """Of two files the later one counts."""
    sheet = tmp_path / "avatars.toml"
    sheet.write_text('[[avatar]]\nname = "Worker"\nheight = 1.5\n', encoding="utf-8")
    found = load_avatars([data_directory("worlds") / "avatars.toml", sheet])
    assert found["worker"].height == 1.5
    assert found["usaravatarworker"].height == SHIPPED["usaravatarworker"].height


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[[avatar]\n", "not valid TOML"),
        ("[[avatar]]\n", "name: is missing"),
        ('[[avatar]]\nname = "A"\nheight = 5\n', "out of range"),
        ('[[avatar]]\nname = "A"\nfigure = "cat"\n', "'cat' is not known"),
        ('[[avatar]]\nname = "A"\nshirt = [1, 1, 9]\n', "from 0 to 1"),
        ('[[avatar]]\nname = "A"\nhight = 1.8\n', "did you mean height?"),
        ('[[person]]\nname = "A"\n', "unknown key"),
    ],
)
def test_slips_are_told(tmp_path: Path, text: str, says: str) -> None:
    """Every error names the file and says what is wrong."""
    sheet = tmp_path / "avatars.toml"
    sheet.write_text(text, encoding="utf-8")
    with pytest.raises(WorldError, match=r"avatars\.toml") as caught:
        load_avatars([sheet])
    assert says in str(caught.value)


@pytest.mark.parametrize("kind", sorted(set(SHIPPED.values()), key=lambda one: one.name))
def test_bodies_stand_on_their_feet(kind: AvatarClass) -> None:
    """With straight legs the soles are at the ground and the crown at the class's height."""
    model = avatar_model(kind).build().compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    pelvis = PELVIS * kind.height / ADULT
    reach = [
        (
            data.geom_xpos[geom][2]
            + data.geom_xmat[geom].reshape(3, 3)[2] @ (model.geom_aabb[geom, :3])
            + sign * abs(data.geom_xmat[geom].reshape(3, 3)[2]) @ model.geom_aabb[geom, 3:]
        )
        for geom in range(model.ngeom)
        for sign in (-1, 1)
    ]
    assert min(reach) + pelvis == pytest.approx(0.0, abs=0.005)
    assert max(reach) + pelvis == pytest.approx(kind.height, abs=0.06)


def test_bodies_are_the_limbs() -> None:
    """Nine bodies that are placed, each where its joint is."""
    kind = AvatarClass("A", height=ADULT)
    model = avatar_model(kind).build().compile()
    names = [model.body(body).name for body in range(1, model.nbody)]
    assert names == ["base", *LIMBS]
    assert (model.nmocap, model.nv) == (9, 0)
    hip, knee = (model.body(f"{limb}_left").pos for limb in ("thigh", "shin"))
    assert knee - hip == pytest.approx(joint_of("shin_left", ADULT))
    left, right = joint_of("upper_arm_left", ADULT), joint_of("upper_arm_right", ADULT)
    assert np.array(left) * [1, -1, 1] == pytest.approx(right)
    with pytest.raises(KeyError):
        joint_of("tail_left", ADULT)
