"""Which names stand for glass."""

from __future__ import annotations

import mujoco
import pytest

from usarsim_server.simulation.rays.scenery import is_glass, words_of


def judged(geom: str, material: str | None) -> bool:
    """Whether a geom of this name and material is glass."""
    spec = mujoco.MjSpec()
    if material is not None:
        spec.add_material(name=material)
    made = spec.worldbody.add_geom(
        name=geom, type=mujoco.mjtGeom.mjGEOM_BOX, size=[1.0, 1.0, 1.0], material=material or ""
    )
    assert made is not None
    return is_glass(spec.compile(), 0)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("wall_pane_12", ["wall", "pane"]),
        ("WindowTrans01", ["window", "trans"]),
        ("LT_Floors.SM.Mat_GLASSPane", ["lt", "floors", "sm", "mat", "glass", "pane"]),
        ("transport_box", ["transport", "box"]),
        ("", []),
    ],
)
def test_names_are_parted_into_words(name: str, words: list[str]) -> None:
    """By capitals, digits and punctuation."""
    assert words_of(name) == words


@pytest.mark.parametrize(
    "material",
    [
        "glass",
        "Trans",
        "TransWhite",
        "HU_Trans_Glass02",
        "windowtrans",
        "plexiglass",
        "robot3:glass",
    ],
)
def test_materials_with_trans_or_glass(material: str) -> None:
    """Infrared goes through materials of imported maps with Trans in their name (checklist 77)."""
    assert judged("panel_1", material)


@pytest.mark.parametrize("name", ["glass_door", "pane-trans", "GlassWall_3", "transparent_box"])
def test_geoms_named_after_glass(name: str) -> None:
    """A geom's own name will do, whatever it is made of."""
    assert judged(name, "metal")


@pytest.mark.parametrize(
    ("geom", "material"),
    [
        ("transport_box", "cardboard"),
        ("transformer_1", None),
        ("hourglass", "sand"),
        ("panel", "TransportBelt"),
        ("panel", "fibreglass"),
        ("translation_stage", "steel"),
    ],
)
def test_words_that_only_look_like_glass(geom: str, material: str | None) -> None:
    """Other words with the same letters are opaque."""
    assert not judged(geom, material)
