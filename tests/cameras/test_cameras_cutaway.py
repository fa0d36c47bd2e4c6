"""Views from above into worlds that lie below a ceiling."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from usarsim_server.app import assemble
from usarsim_server.cameras.cutaway import CUT_COLOR, VIEW_CUT, find_cutaway
from usarsim_server.cameras.painter import Painter, PainterOptions
from usarsim_server.cameras.posed_model import Stage
from usarsim_server.cameras.spectators import Viewpoint, named_viewpoints
from usarsim_server.cameras.view import View
from usarsim_server.settings import Settings
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.simulation import Simulation, SimulationOptions
from usarsim_server.worlds.description import StartPose, WorldDescription

WALLS = (
    # A bunker of 6 x 4 m with walls of half a metre: sizes are halves.
    ("floor", (0, 0, -0.25), (3.5, 2.5, 0.25)),
    ("north", (3.25, 0, 1.5), (0.25, 2.5, 1.5)),
    ("south", (-3.25, 0, 1.5), (0.25, 2.5, 1.5)),
    ("east", (0, -2.25, 1.5), (3.0, 0.25, 1.5)),
    ("west", (0, 2.25, 1.5), (3.0, 0.25, 1.5)),
)
SCENERY = "".join(
    f'<geom name="{name}" type="box" pos="{x} {y} {z}" size="{a} {b} {c}"/>'
    for name, (x, y, z), (a, b, c) in WALLS
)
CRATE = (
    '<body name="crate" pos="1 1 .3"><freejoint/>'
    '<geom name="crate" type="box" size=".3 .3 .3" rgba="1 0 0 1"/></body>'
)
START = StartPose("S", Pose((0.0, 0.0, 0.25)))


def bunker(roof: str) -> tuple[Simulation, WorldDescription]:
    """The bunker with a roof."""
    text = f"<mujoco><worldbody>{SCENERY}{roof}{CRATE}</worldbody></mujoco>"
    simulation = Simulation(lambda: mujoco.MjSpec.from_string(text), SimulationOptions())
    box = {"lower": (-20.0, -20.0, -10.0), "upper": (20.0, 20.0, 20.0)}
    nowhere = Path("/nowhere")
    return simulation, WorldDescription("w", "w", "w", "", nowhere, nowhere, (START,), **box)


def roof(height: float) -> str:
    """A lid of half a metre whose lower face is that high."""
    place, size = f"0 0 {height + 0.25}", "3.5 2.5 .25"
    return f'<geom name="roof" type="box" pos="{place}" size="{size}" rgba="0 0 1 1"/>'


def views(
    simulation: Simulation, world: WorldDescription, *, open_roofs: bool = True
) -> dict[str, Viewpoint]:
    """Of a world, by name."""
    snapshot = simulation.look()
    stage = Stage(simulation.compiled(snapshot))
    stage.show(snapshot)
    return named_viewpoints(stage, world, open_roofs=open_roofs)


def shot(
    simulation: Simulation, view: Viewpoint, renderer: str, mode: str = "rgb"
) -> NDArray[np.float64]:
    """A picture of a view."""
    painter = Painter(simulation.compiled, PainterOptions(renderer))
    try:
        wanted = View(view.pose, view.fov, 160, 120, mode, view.cut)  # type: ignore[arg-type]
        return np.asarray(painter.picture(wanted, simulation.look()), dtype=float)
    finally:
        painter.close()


@pytest.fixture(params=["rays", "gl"])
def renderer(request: pytest.FixtureRequest) -> str:
    """What draws."""
    return "rays" if request.param == "rays" else str(request.getfixturevalue("gl"))


@pytest.mark.parametrize("name", ["top", "overview"])
def test_one_looks_into_a_bunker(renderer: str, name: str) -> None:
    """Its roof is gone, floor and crate are seen, walls are dark where they are cut."""
    simulation, world = bunker(roof(3.0))
    view = views(simulation, world)[name]
    assert view.cut == pytest.approx(VIEW_CUT)
    model = simulation.compiled(simulation.look()).model
    seen = shot(simulation, view, renderer, "segmentation").astype(int)
    parts = {
        geom: float((seen == model.geom(geom).id).mean()) for geom in ("floor", "crate", "north")
    }
    assert parts["floor"] > 0.05
    assert parts["crate"] > 0.003
    assert parts["north"] > 0.01
    assert not (seen == model.geom("roof").id).any()
    colors = shot(simulation, view, renderer)
    dark = (np.abs(colors - 255.0 * CUT_COLOR).max(axis=2) < 2.0).mean()
    assert dark == pytest.approx(0.12, abs=0.08)
    assert ((colors[..., 0] > 50.0) & (colors[..., 0] > 2.0 * colors[..., 1])).any(), (
        "the crate is red"
    )
    depth = shot(simulation, view, renderer, "depth")
    if name == "top":
        height = view.pose.position[2]
        assert depth.min() == pytest.approx(height - VIEW_CUT, abs=0.01)
        assert depth[60, 80] == pytest.approx(height, abs=0.02)


@pytest.mark.parametrize("height", [0.6, 1.4])
def test_low_ceilings(height: float) -> None:
    """The cut is below a ceiling that is lower than people."""
    simulation, world = bunker(roof(height))
    assert views(simulation, world)["top"].cut == pytest.approx(height - 0.02, abs=1e-3)


@pytest.mark.parametrize("lid", ["", '<geom type="box" pos="2 1 2.5" size=".9 .9 .1"/>'])
def test_open_worlds_stay(lid: str) -> None:
    """Without a roof, or with one over a corner, nothing is cut, and the views are the old ones."""
    simulation, world = bunker(lid)
    assert views(simulation, world) == views(simulation, world, open_roofs=False)
    assert math.isinf(views(simulation, world)["overview"].cut)


@pytest.mark.parametrize("name", ["arena", "office", "plant", "smoke_corridor", "empty"])
def test_shipped_worlds_stay(name: str) -> None:
    """None of them lies below ceilings."""
    ports = ("port", "image_port", "groundtruth_port", "wireless_port", "truth_port")
    quiet = dict.fromkeys(ports)
    assembly = assemble(Settings(world=name, speed=math.inf, **quiet))  # type: ignore[arg-type]
    try:
        simulation, world = assembly.simulation, assembly.world
        model = simulation.compiled(simulation.look()).model
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        places = [start.pose.position for start in world.starts]
        low, high = np.array(world.lower), np.array(world.upper)
        assert math.isinf(find_cutaway(model, data, places, low, high).level)
    finally:
        assembly.stop()


def test_both_renderers_cut_alike(gl: str) -> None:
    """They agree in depth all over the picture but at edges."""
    simulation, world = bunker(roof(3.0))
    view = views(simulation, world)["overview"]
    one, other = (shot(simulation, view, renderer, "depth") for renderer in ("rays", gl))
    known = np.isfinite(one) & np.isfinite(other)
    assert known.mean() > 0.2
    assert (np.isfinite(one) == np.isfinite(other)).mean() > 0.98
    assert np.median(np.abs(one[known] - other[known])) < 0.01
