"""Worlds of very many fixed pieces: served in parts, bounded, and their cost told."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

from usarsim_maps.convert import Request, import_map
from usarsim_maps.reader import ImportOptions
from usarsim_server.base.errors import MapImportError, WorldError
from usarsim_server.simulation.simulation import Simulation, SimulationOptions
from usarsim_server.world_cost import WorldCost, WorldLimits, cost_of, most_pieces, owners_in
from usarsim_server.worlds import solids
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_in_parts, build_scene

LIMIT = 100


@pytest.fixture(scope="module")
def hall(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A world of 128 pieces: 16 copies of a bowl of 8 triangles, which is not convex."""
    folder = tmp_path_factory.mktemp("hall")
    return import_map(Request(map_of_bowls(folder), out=folder, cache=folder / "cache")).folder


def map_of_bowls(folder: Path) -> Path:
    """A map in OBJ files: a world of SDF with copies of one mesh."""
    rim = [
        (math.cos(a), math.sin(a), 0.6 + 0.2 * (k % 2))
        for k, a in enumerate(np.linspace(0, math.tau, 9)[:8])
    ]
    lines = ["v 0 0 0", *(f"v {2 * x:.4f} {2 * y:.4f} {z:.4f}" for x, y, z in rim)]
    lines += [f"f 1 {k + 2} {(k + 1) % 8 + 2}" for k in range(8)]
    (folder / "bowl.obj").write_text("\n".join(lines) + "\n")
    mesh = "<geometry><mesh><uri>bowl.obj</uri></mesh></geometry>"
    models = "".join(
        f'<model name="Bowl_{n}"><static>1</static>'
        f"<pose>{5 * (n % 4)} {5 * (n // 4)} 0 0 0 0</pose>"
        f'<link name="l"><visual name="v">{mesh}</visual>'
        f'<collision name="c">{mesh}</collision></link></model>'
        for n in range(16)
    )
    source = folder / "hall.world"
    source.write_text(f'<sdf version="1.6"><world name="w">{models}</world></sdf>')
    return source


def test_in_parts_is_the_whole(hall: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is compiled apart and what is not make the same geoms, and rays meet the same."""
    world = load_world(hall)
    monkeypatch.setattr(solids, "LEAST", 16)
    spec, fixed = build_in_parts(world)
    assert fixed is not None
    joined = fixed.into(spec.compile())
    whole = build_scene(world).compile()
    assert joined.ngeom == whole.ngeom
    assert joined.nmesh == whole.nmesh
    assert len(spec.geoms) + fixed.count == whole.ngeom

    def rows(model: mujoco.MjModel) -> list[bytes]:
        columns = (model.geom_pos, model.geom_quat, model.geom_size, model.geom_friction)
        return sorted(np.hstack(columns).round(9).view("V104").ravel().tolist())

    assert rows(joined) == rows(whole)


def test_small_worlds_stay_whole(hall: Path) -> None:
    """As they were."""
    assert build_in_parts(load_world(hall))[1] is None


def test_a_robot_comes(hall: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A model that grows has the fixed pieces again; what never moves keeps its numbers."""
    monkeypatch.setattr(solids, "LEAST", 16)
    world = load_world(hall)
    spec, fixed = build_in_parts(world)
    simulation = Simulation(spec.copy, SimulationOptions(), fixed)
    before = simulation._engine.world
    growth = simulation._engine.grow(())
    assert growth.world.generation == before.generation + 1
    assert growth.world.model.ngeom == before.model.ngeom
    assert np.array_equal(growth.world.model.geom_pos, before.model.geom_pos)


def test_other_files_stay_attached(
    hall: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A frame with a pose, or a file that holds more, is compiled with the scene."""
    monkeypatch.setattr(solids, "LEAST", 1)
    moved = tmp_path / "moved"
    shutil.copytree(hall, moved)
    scene = moved / "scene.xml"
    scene.write_text(scene.read_text().replace("<frame><attach", '<frame pos="0 0 1"><attach'))
    assert solids.read_apart(scene) is None
    more = tmp_path / "more"
    shutil.copytree(hall, more)
    file = next((more / "solids").iterdir())
    file.write_text(file.read_text().replace("</worldbody>", "<light/></worldbody>"))
    assert solids.read_apart(more / "scene.xml") is None


class TestBounds:
    """Pieces and memory."""

    def test_import_names_the_largest(self, tmp_path: Path) -> None:
        """What to leave out, and how to raise the bound."""
        options = ImportOptions(limits=WorldLimits(pieces=LIMIT))
        request = Request(
            map_of_bowls(tmp_path), out=tmp_path, cache=tmp_path / "c", options=options
        )
        with pytest.raises(MapImportError) as caught:
            import_map(request)
        text = str(caught.value)
        assert "at least 108 pieces are more than 100 (max_pieces); so far, most pieces:" in text
        assert "Bowl* (108 in 12 things)" in text
        assert "exclude = true" in text
        assert "--max-pieces" in text

    def test_serving(self, hall: Path) -> None:
        """The same bounds hold for a world folder, before MuJoCo reads it."""
        world = load_world(hall)
        with pytest.raises(WorldError) as caught:
            build_in_parts(world, limits=WorldLimits(pieces=LIMIT))
        text = str(caught.value)
        assert "144 pieces are more than 100 (max_pieces)" in text
        assert "most pieces: Bowl* (144 in 16 things)" in text

    def test_all_kinds_of_pieces_are_named(self) -> None:
        """Geoms with names, without, and those of bodies, by things of one name."""
        owners = owners_in(
            b'<geom name="Wall_1.solid0"/><geom name="Wall_2.solid"/><geom type="plane"/>'
            b'<body name="crate 7"><geom/><body><geom name="lid"/><geom size="1"/></body></body>'
            b'<body name="empty"/><geom pos="0 0 1"/><geometry/>'
        )
        assert owners == {"Wall_1": 1, "Wall_2": 1, "": 2, "crate 7": 2, "lid": 1}
        told = most_pieces(owners)
        assert "Wall* (2 in 2 things)" in told
        assert "without a name (2)" in told
        assert "crate (2)" in told

    def test_primitives_and_movable_things(self, tmp_path: Path) -> None:
        """They have pieces, too."""
        box = "<geometry><box><size>1 1 1</size></box></geometry>"
        models = "".join(
            f'<model name="{kind}_{n}"><static>{static}</static><pose>{3 * n} {y} 1 0 0 0</pose>'
            f'<link name="l"><visual name="v">{box}</visual><collision name="c">{box}</collision>'
            f"</link></model>"
            for kind, static, y in (("Post", 1, 0), ("Crate", 0, 5))
            for n in range(3)
        )
        source = tmp_path / "mixed.world"
        source.write_text(f'<sdf version="1.6"><world name="w">{models}</world></sdf>')
        options = ImportOptions(limits=WorldLimits(pieces=5))
        with pytest.raises(MapImportError) as caught:
            import_map(Request(source, out=tmp_path, cache=tmp_path / "c", options=options))
        assert "Post* (" in str(caught.value)
        assert "Crate* (" in str(caught.value)

    def test_memory(self) -> None:
        """Of many large hulls."""
        cost = WorldCost(1000, 1000, 1_000_000)
        assert cost.excess(WorldLimits(memory=300)) is None
        assert cost.excess(WorldLimits(memory=200)) is not None

    def test_triangles_of_copies(self, hall: Path) -> None:
        """Rays keep those of each copy of a mesh; a bound holds for them, too."""
        cost = cost_of(hall / "scene.xml")
        assert cost.triangles == 16 * 8
        assert WorldCost(470, triangles=470 * 10_000).excess(WorldLimits()) is None
        dense = WorldCost(4700, triangles=4700 * 10_000)
        assert "triangles of all copies" in str(dense.excess(WorldLimits()))

    def test_bounds_and_estimates(self) -> None:
        """A world that reaches both default bounds is estimated at 2 s from INIT at most."""
        limits = WorldLimits()
        rest = (limits.memory << 20) - 500 * limits.pieces
        assert 1.5 < WorldCost(limits.pieces, meshes=rest).init <= 2.0

    def test_estimate(self, hall: Path) -> None:
        """Pieces are counted exactly; memory is near that of the model."""
        model = build_scene(load_world(hall)).compile()
        cost = cost_of(hall / "scene.xml")
        assert cost.pieces == model.ngeom
        assert 0.3 < cost.memory / (mujoco.mj_sizeModel(model) / 2**20) < 2.0

    def test_report(self, hall: Path) -> None:
        """The import says what the world will cost."""
        found = import_map(
            Request(hall.parent / "hall.world", cache=hall.parent / "cache", name="hall")
        )
        assert "pieces" in found.report.totals["to serve"]
        assert "after INIT" in found.report.text()
