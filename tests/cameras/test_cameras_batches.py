"""Geoms that are drawn together look as if each had been drawn for itself."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from usarsim_server.cameras.backend import Quality, Wanted
from usarsim_server.cameras.batches import CELL, batches, rgba, shape
from usarsim_server.cameras.facets import facets
from usarsim_server.cameras.gl import GlBackend
from usarsim_server.cameras.posed_model import HIDDEN_GROUP, Stage
from usarsim_server.cameras.view import Eye, looking

SHAPES = """
<geom type="box" size="0.3 0.2 0.1" pos="0 0 0.4" euler="20 30 40" rgba="0.9 0.1 0.1 1"/>
<geom type="sphere" size="0.2" pos="0 0.7 0.3" rgba="0.1 0.9 0.1 1"/>
<geom type="ellipsoid" size="0.3 0.1 0.2" pos="0 -0.7 0.3" euler="0 0 40" rgba="0.1 0.1 0.9 1"/>
<geom type="capsule" size="0.1 0.3" pos="0.6 0 0.4" euler="30 0 0" material="dull"/>
<geom type="cylinder" size="0.2 0.1" pos="0.6 0.7 0.3" euler="60 0 0" rgba="0.9 0.9 0.1 1"/>
<geom type="mesh" mesh="wedge" pos="0.6 -0.7 0.2" euler="0 0 70" rgba="0.1 0.9 0.9 1"/>
"""
WORLD = f"""
<mujoco>
  <asset>
    <texture name="tiles" type="2d" builtin="checker" rgb1="0.4 0.4 0.4" rgb2="0.6 0.6 0.6"
      width="64" height="64"/>
    <texture type="skybox" builtin="gradient" rgb1="0.5 0.6 0.8" rgb2="0.2 0.3 0.5"
      width="64" height="384"/>
    <material name="tiles" texture="tiles" texrepeat="1 1" texuniform="true" specular="0.05"/>
    <material name="dull" rgba="0.8 0.4 0.2 1" specular="0" shininess="0"/>
    <mesh name="wedge" vertex="-.3 -.2 0 .3 -.2 0 .3 .2 0 -.3 .2 0 .3 -.2 .3 .3 .2 .3"/>
  </asset>
  <worldbody>
    <light directional="true" dir="0.3 0.2 -1"/>
    <geom name="floor" type="plane" size="0 0 1" material="tiles"/>
    {SHAPES}
    <geom type="box" size="0.5 0.5 0.5" pos="-3 0 0.5" material="tiles"/>
    <geom type="box" size="0.2 0.2 0.2" pos="0 0 1.2" rgba="1 1 1 0.4"/>
    <body pos="2 1 0" euler="0 0 50"><freejoint/>{SHAPES}</body>
    <body pos="2 -1 0" euler="10 0 90"><freejoint/>{SHAPES}</body>
  </worldbody>
</mujoco>
"""
VIEWS = (
    ((4.0, 0.0, 1.5), (0.0, 0.0, 0.3)),
    ((0.3, 0.2, 0.6), (2.0, 1.0, 0.3)),  # close by, in the midst
    ((30.0, 4.0, 6.0), (0.0, 0.0, 0.0)),  # far away, where round shapes are coarse
    ((1.0, 0.0, -2.0), (1.0, 0.5, 1.0)),  # from under the floor
)


def stage_of(xml: str) -> Stage:
    """What the renderer needs of a stage."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    groups = model.geom_group.copy()
    return SimpleNamespace(model=model, data=data, groups=groups)  # type: ignore[return-value]


def eye_at(position: tuple[float, float, float], target: tuple[float, float, float]) -> Eye:
    """An eye of 160 x 120 pixels."""
    return Eye(looking(position, target), 1.2, 160, 120)


@pytest.fixture
def backend(gl: str) -> Iterator[GlBackend]:
    """The renderer that makes batches."""
    one = GlBackend(gl, Quality())
    yield one
    one.close()


def picture(backend: GlBackend, stage: Stage, eye: Eye, *, exact: bool = False) -> NDArray[np.int_]:
    """What an eye sees."""
    return backend.render(stage, eye, Wanted(exact=exact)).colors.astype(int)


@pytest.mark.parametrize("view", VIEWS)
def test_pictures_are_those_of_single_geoms(
    backend: GlBackend, view: tuple[tuple[float, float, float], tuple[float, float, float]]
) -> None:
    """Shapes, places, colours, gloss and light are the same, but for pixels at edges."""
    stage, eye = stage_of(WORLD), eye_at(*view)
    apart = np.abs(picture(backend, stage, eye) - picture(backend, stage, eye, exact=True))
    assert apart.mean() < 0.5
    assert (apart.max(axis=2) > 12).mean() < 0.01


def test_pictures_stay_when_models_take_turns(backend: GlBackend) -> None:
    """Lists are made anew after another model was drawn, and a model is left as it was."""
    one, eye = stage_of(WORLD), eye_at(*VIEWS[0])
    other = stage_of(WORLD.replace('size="0.3 0.2 0.1"', 'size="0.4 0.2 0.1"'))
    before = one.model.geom_type.copy(), one.model.geom_dataid.copy(), one.model.geom_group.copy()
    first = picture(backend, one, eye)
    assert (picture(backend, other, eye) != first).any()
    assert (picture(backend, one, eye) == first).all()
    after = one.model.geom_type, one.model.geom_dataid, one.model.geom_group
    assert all((a == b).all() for a, b in zip(before, after, strict=True))


def test_what_is_parked_is_not_drawn(backend: GlBackend) -> None:
    """A hidden body is missing from its batch's place."""
    stage, eye = stage_of(WORLD), eye_at(*VIEWS[0])
    picture(backend, stage, eye)
    stage.model.geom_group[stage.model.geom_bodyid == 1] = HIDDEN_GROUP
    apart = np.abs(picture(backend, stage, eye) - picture(backend, stage, eye, exact=True))
    assert (apart.max(axis=2) > 12).mean() < 0.01


def test_nothing_behind_the_eye_is_drawn(backend: GlBackend) -> None:
    """A look away draws the floor only; one into the scene a batch for each body and gloss."""
    stage = stage_of(WORLD)
    picture(backend, stage, eye_at((10.0, 0.0, 1.0), (20.0, 0.0, 1.0)))
    assert backend.drawn == 1
    picture(backend, stage, eye_at((10.0, 0.0, 1.0), (0.0, 0.0, 0.5)))
    assert backend.drawn < stage.model.ngeom / 1.5


class TestBatches:
    """What goes together."""

    def test_of_bodies_and_gloss(self) -> None:
        """Textured and transparent geoms stay alone; equal bodies have equal keys."""
        stage = stage_of(WORLD)
        found = batches(stage.model, stage.groups)
        sizes = sorted(len(batch.geoms) for batch in found)
        cells = len({tuple(np.floor(stage.model.geom_pos[g] / CELL)) for g in range(1, 7)})
        assert sum(sizes) == 1 + 3 * 6
        assert len(found) <= 1 + 2 * 2 + cells + 1
        by_body = {
            body: {b.key for b in found if stage.model.geom_bodyid[b.leader] == body}
            for body in (1, 2)
        }
        assert by_body[1] == by_body[2]
        assert len(by_body[1]) == 2

    def test_hidden_geoms_are_in_none(self) -> None:
        """Groups from 3 on are never drawn."""
        stage = stage_of(WORLD)
        stage.groups[1] = 3
        assert all(1 not in batch.geoms for batch in batches(stage.model, stage.groups))

    def test_corners_are_in_the_frame_of_the_leader(self) -> None:
        """The batch of a body, moved to where its leader is, surrounds all of its geoms."""
        stage = stage_of(WORLD)
        batch = max(
            (
                b
                for b in batches(stage.model, stage.groups)
                if stage.model.geom_bodyid[b.leader] == 1
            ),
            key=lambda batch: len(batch.geoms),
        )
        corners = shape(stage.model, batch.geoms, rgba(stage.model), 12, 6)[:, :3].astype(float)
        turn = stage.data.geom_xmat[batch.leader].reshape(3, 3)
        places = corners @ turn.T + stage.data.geom_xpos[batch.leader]
        for geom in batch.geoms:
            assert (places.min(axis=0) < stage.data.geom_xpos[geom]).all()
            assert (places.max(axis=0) > stage.data.geom_xpos[geom]).all()


VOLUMES = {
    "box": 8 * 0.3 * 0.2 * 0.1,
    "sphere": 4 / 3 * math.pi * 0.2**3,
    "ellipsoid": 4 / 3 * math.pi * 0.3 * 0.1 * 0.2,
    "capsule": math.pi * 0.1**2 * (0.6 + 4 / 3 * 0.1),
    "cylinder": math.pi * 0.2**2 * 0.2,
    "mesh": 0.6 * 0.4 * 0.3 / 2,
}


@pytest.mark.parametrize(("kind", "fine"), [*itertools.product(VOLUMES, (True, False))])
def test_facets_enclose_the_shape(kind: str, fine: bool) -> None:
    """All face outwards, so that they enclose nearly the volume; normals agree with them."""
    model = stage_of(WORLD).model
    number = 1 + list(VOLUMES).index(kind)
    found = facets(model, number, *((48, 24) if fine else (8, 4))).astype(float)
    a, b, c = (found[k::3, 0] for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    assert volume == pytest.approx(VOLUMES[kind], rel=0.02 if fine else 0.35)
    across = np.cross(b - a, c - a)
    for k in range(3):
        assert (np.einsum("ij,ij->i", across, found[k::3, 1]) > 0.0).all()
    assert np.linalg.norm(found[:, 1], axis=1) == pytest.approx(np.ones(len(found)), abs=1e-5)
