"""Triangle soups into convex pieces (worlds reference 9 and 13, items 58 to 63)."""

from __future__ import annotations

import numpy as np
import pytest
from built_worlds import (
    blocks,
    cuboid_mesh,
    grid_mesh,
    holed_plate,
    is_convex,
    joined,
    mesh_of,
    polygon_area,
    ramp_mesh,
    torus,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from usarsim_maps.build.contact import FLOOR, LEAST, THICKNESS, UNDER, collide, slabs
from usarsim_maps.build.convex import convex_parts
from usarsim_maps.build.orientation import orient
from usarsim_maps.build.pieces import (
    BoxPiece,
    Convex,
    FieldPiece,
    HullPiece,
    Piece,
    corners_of,
    hull_piece,
    volumes,
)
from usarsim_maps.build.soup import Soup, clean, components, convex_polygons
from usarsim_maps.build.terrain import as_terrain, is_rolling
from usarsim_maps.geometry import normals_areas
from usarsim_maps.scene import Collision, Mesh
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy

UP = np.array([0.0, 0.0, 1.0])


def soup_of(*meshes: Mesh) -> Soup:
    """The clean triangles of some meshes together."""
    whole = joined(*meshes)
    return clean(whole.vertices, whole.triangles)


class TestCleaning:
    """What comes from files is dirty."""

    def test_bad_triangles_are_dropped_and_counted(self) -> None:
        """Zero-area, double and non-finite triangles go; the good one stays (worlds 60)."""
        vertices = np.array(
            [[0, 0, 0], [1, 0, 0], [0, 1, 0], [np.nan, 0, 0], [2, 0, 0], [0, 1, 1e-7]]
        )
        triangles = [[0, 1, 2], [0, 1, 2], [2, 1, 0], [0, 1, 3], [0, 1, 4], [0, 1, 5], [0, 0, 1]]
        soup = clean(vertices, np.array(triangles, dtype=np.int32))
        assert len(soup.triangles) == 1
        assert soup.dropped == 6
        assert soup.origin.tolist() == [0]

    def test_unknown_vertices_are_refused(self) -> None:
        """A triangle that refers to nothing is an error, not a crash."""
        with pytest.raises(ValueError, match="vertex 7 of 3"):
            clean(np.zeros((3, 3)), np.array([[0, 1, 7]], dtype=np.int32))

    def test_components_are_found_in_order(self) -> None:
        """Two boxes and a floor are three components; the first is that of the first triangle."""
        soup = soup_of(
            cuboid_mesh((0, 0, 0), (1, 1, 1)),
            cuboid_mesh((3, 0, 0), (4, 1, 1)),
            grid_mesh(3, 3, 50.0),
        )
        sizes = [len(part) for part in components(soup)]
        assert sizes == [12, 12, 18]
        assert sum(map(len, components(soup))) == len(soup.triangles)


class TestMerging:
    """Coplanar triangles become convex polygons."""

    def test_a_tiled_floor_becomes_one_polygon(self) -> None:
        """200 coplanar triangles give one rectangle of four corners (worlds 61, 62)."""
        rings = convex_polygons(soup_of(grid_mesh(10, 10, 10.0)))
        assert [len(ring) for _, ring in rings] == [4]

    def test_pairs_halve_the_count(self) -> None:
        """A 10 000-triangle mesh of coplanar pairs gives at most half as many polygons
        (worlds 61)."""
        dice = np.random.default_rng(0)
        steps = np.repeat(dice.uniform(0, 1, 50), 2)[:101]
        heights = np.tile(np.concatenate([steps, steps[:1]])[:101], (51, 1))
        soup = soup_of(grid_mesh(100, 50, 100.0, heights))
        assert len(soup.triangles) == 10_000
        assert len(convex_polygons(soup)) <= 5_000

    @given(st.integers(0, 10_000))
    @settings(max_examples=30, deadline=None)
    def test_area_and_convexity(self, seed: int) -> None:
        """Polygons cover what the triangles covered, and each of them is convex."""
        dice = np.random.default_rng(seed)
        heights = np.round(dice.uniform(0, 2, (6, 6)))  # flat patches and steps
        soup = soup_of(grid_mesh(5, 5, 5.0, heights))
        _, areas = normals_areas(soup.vertices, soup.triangles)
        polygons = [soup.vertices[list(ring)] for _, ring in convex_polygons(soup)]
        assert sum(map(polygon_area, polygons)) == pytest.approx(areas.sum(), rel=1e-4)
        assert all(map(is_convex, polygons))

    def test_windings_need_not_agree(self) -> None:
        """A floor whose triangles face both ways is still one polygon."""
        mesh = grid_mesh(4, 4, 4.0)
        turned = mesh.triangles.copy()
        turned[::3] = turned[::3, ::-1]
        soup = clean(mesh.vertices, turned)
        assert len(convex_polygons(orient(soup, UP).soup)) == 1


class TestSlabs:
    """Polygons become thin solids behind the surface."""

    def test_floors_are_thicker_than_walls(self) -> None:
        """A room's floor gets 10 cm, its walls 5 cm, its ceiling 8 mm, all outside the room."""
        pieces = slabs(orient(soup_of(cuboid_mesh((0, 0, 0), (4, 4, 3), inward=True)), UP), UP)
        assert all(isinstance(piece, BoxPiece) for piece in pieces)
        thin = sorted(2 * min(p.half) for p in pieces if isinstance(p, BoxPiece))
        assert thin == pytest.approx([UNDER, *[THICKNESS] * 4, FLOOR])
        for piece in pieces:
            assert isinstance(piece, BoxPiece)
            inside = np.abs(np.array(piece.pose.position) - [2, 2, 1.5]) < [2, 2, 1.5]
            assert not inside.all()

    def test_thin_walls_are_not_pierced(self) -> None:
        """Slabs of a wall of 2 cm stay within it; coincident faces leave a thin plate."""
        pieces = slabs(orient(soup_of(cuboid_mesh((0, 0, 0), (4, 0.02, 3))), UP), UP)
        for piece in pieces:
            assert isinstance(piece, BoxPiece)
            corners = np.abs(piece.pose.matrix()) @ piece.half
            low = np.array(piece.pose.position) - corners
            high = np.array(piece.pose.position) + corners
            assert low[1] > -1e-6
            assert high[1] < 0.02 + 1e-6
        assert LEAST < 0.02

    def test_triangles_become_hulls(self) -> None:
        """A polygon that is no rectangle becomes a hull with its front face exact."""
        triangle = Mesh(
            "t", np.array([[0, 0, 1], [2, 0, 1], [0, 2, 1]], float), np.array([[0, 1, 2]], np.int32)
        )
        (piece,) = slabs(orient(soup_of(triangle), UP), UP)
        assert isinstance(piece, HullPiece)
        assert piece.points[:, 2].max() == 1.0
        assert piece.points[:, 2].min() == pytest.approx(1.0 - FLOOR)

    @pytest.mark.parametrize("bottom", [False, True])
    @pytest.mark.parametrize("degrees", [10, 30, 45, 60])
    @pytest.mark.parametrize("turn", range(3))
    def test_nothing_stands_out(self, degrees: float, bottom: bool, turn: int) -> None:
        """Behind the back and the underside of an inclined face no slab stands out by 1 cm,
        whatever way it is turned."""
        mesh = ramp_mesh(degrees, bottom)
        pose = Pose((turn, 0.5, 0.2), quaternion_from_rpy(0.0, 0.0, turn * 0.7))
        matrix, place = pose.matrix(), np.array(pose.position)
        soup = soup_of(mesh_of(mesh.vertices @ matrix.T + place, mesh.triangles))
        slope = np.tan(np.radians(degrees))
        for piece in slabs(orient(soup, UP), UP):
            assert not isinstance(piece, FieldPiece)
            x, y, z = ((corners_of(piece) - place) @ matrix).T
            assert x.max() < 2.01
            assert y.min() > -0.01
            assert y.max() < 1.01
            assert ((z - slope * x) * np.cos(np.radians(degrees))).max() < 0.01
            if bottom:
                assert z.min() > -0.01

    def test_slabs_stay_thick(self) -> None:
        """What stands out is cut off at its corners only: a slope keeps its 10 cm in the middle."""
        (slope,) = (
            piece
            for piece in slabs(orient(soup_of(ramp_mesh(30, bottom=False)), UP), UP)
            if np.ptp(corners_of(piece)[:, 0]) > 1.5 and np.ptp(corners_of(piece)[:, 1]) > 0.9
        )
        assert volumes([slope])[0] > 0.8 * 0.1 * 2.0 / np.cos(np.radians(30))


class TestCutting:
    """Closed shapes become few convex pieces."""

    def parts(self, mesh: Mesh, most: int = 64) -> list[Convex] | None:
        """Pieces of one mesh."""
        return convex_parts(orient(soup_of(mesh), UP), most)

    @pytest.mark.parametrize(
        ("mesh", "most", "volume"),
        [
            (cuboid_mesh((0, 0, 0), (1, 2, 3)), 1, 6.0),
            (holed_plate(64, 0.3, 2.0, 0.015), 40, 0.015 * (4.0 - 0.2823)),
            (torus(32, 16, 0.5, 0.12), 32, 0.13761),
            (ramp_mesh(30), 1, 2.0 * np.tan(np.pi / 6)),
        ],
    )
    def test_pieces_fill_the_shape(self, mesh: Mesh, most: int, volume: float) -> None:
        """Pieces are few, and together as large as the shape."""
        pieces = self.parts(mesh)
        assert pieces is not None
        assert len(pieces) <= most
        assert volumes(pieces).sum() == pytest.approx(volume, rel=0.005)

    @given(st.integers(0, 2**27 - 1))
    @settings(max_examples=25, deadline=None)
    def test_blocks(self, bits: int) -> None:
        """Any heap of blocks that is one thing is cut into pieces of its volume, none of which
        holds the middle of a block that is missing."""
        filled = np.array([bits >> k & 1 for k in range(27)], dtype=bool).reshape(3, 3, 3)
        filled[1, 1, :] = filled[:, 1, 1] = True
        edges = (0.0, 0.3, 0.5, 1.1)
        soup = soup_of(blocks(filled, edges, edges, edges))
        pieces = convex_parts(orient(soup, UP), 64)
        if pieces is None:
            return  # blocks that touch at edges only need not be closed
        sizes = np.diff(edges)
        space = np.einsum("i,j,k->ijk", sizes, sizes, sizes)
        assert volumes(pieces).sum() == pytest.approx(space[filled].sum(), rel=0.01)

    def test_what_is_open_or_rough_is_not_cut(self) -> None:
        """A shape without its underside has no inside; a rough ball needs too many pieces."""
        assert self.parts(ramp_mesh(30, bottom=False)) is None
        rough = torus(24, 12, 0.5, 0.3)
        shaken = np.random.default_rng(1).uniform(-0.04, 0.04, rough.vertices.shape)
        assert self.parts(mesh_of(rough.vertices + shaken, rough.triangles)) is None

    def test_the_same_shape_is_cut_alike(self) -> None:
        """Twice the same input, twice the same pieces."""
        one, other = (self.parts(holed_plate(24, 0.2, 1.2, 0.1)) for _ in range(2))
        assert one is not None
        assert other is not None
        for a, b in zip(one, other, strict=True):
            assert np.array_equal(corners_of(a), corners_of(b))


class TestChoosing:
    """Which pieces an object gets (worlds 9.4)."""

    def pieces(self, mesh: Mesh, mode: Collision = Collision.AUTO, **more: object) -> list[Piece]:
        """Pieces of one mesh."""
        return collide(soup_of(mesh), mode, UP, **more)  # type: ignore[arg-type]

    def test_a_solid_block_is_one_hull(self) -> None:
        """A closed convex component is one piece."""
        assert len(self.pieces(cuboid_mesh((0, 0, 0), (1, 2, 1)))) == 1

    @pytest.mark.parametrize("seed", range(4))
    def test_turned_boxes_are_boxes(self, seed: int) -> None:
        """A crate is one box, whatever way it stands; a frustum is a hull (worlds 62)."""
        mesh = cuboid_mesh((0, 0, 0), (1, 2, 1.5))
        turn = quaternion_from_rpy(*np.random.default_rng(seed).uniform(-3, 3, 3).tolist())
        pose = Pose((3.0, -2.0, 1.0), turn)
        corners = mesh.vertices @ pose.matrix().T + np.array(pose.position)
        middle = pose.matrix() @ np.array([0.5, 1.0, 0.75]) + np.array(pose.position)
        (piece,) = self.pieces(mesh_of(corners, mesh.triangles))
        assert isinstance(piece, BoxPiece)
        assert sorted(piece.half) == pytest.approx([0.5, 0.75, 1.0])
        assert piece.pose.position == pytest.approx(middle.tolist())
        corners[np.argmax(corners[:, 2])] += 0.01
        (piece,) = self.pieces(mesh_of(corners, mesh.triangles))
        assert isinstance(piece, HullPiece)

    def test_thin_crates_are_no_plates(self) -> None:
        """A closed board is one box, not a slab for each of its faces."""
        (piece,) = self.pieces(cuboid_mesh((0, 0, 0), (2, 1, 0.02)))
        assert isinstance(piece, BoxPiece)
        assert piece.half == pytest.approx((1.0, 0.5, 0.01))

    def test_a_room_is_not_filled(self) -> None:
        """A closed box that looks inwards is a room of six slabs."""
        assert len(self.pieces(cuboid_mesh((0, 0, 0), (4, 4, 3), inward=True))) == 6

    def test_the_artist_knows_best(self) -> None:
        """Where there are authored hulls only they collide."""
        mesh = cuboid_mesh((0, 0, 0), (4, 4, 3), inward=True)
        hull = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
        (piece,) = self.pieces(mesh, hulls=(hull,))
        assert volumes([piece])[0] == pytest.approx(1 / 6, rel=1e-3)

    @pytest.mark.parametrize(
        ("mode", "count"),
        [(Collision.NONE, 0), (Collision.BOX, 1), (Collision.HULL, 1), (Collision.SURFACE, 6)],
    )
    def test_modes(self, mode: Collision, count: int) -> None:
        """What the map asks for is done."""
        assert len(self.pieces(cuboid_mesh((0, 0, 0), (1, 1, 1)), mode)) == count

    def test_few_pieces_are_enough_where_they_are_true(self) -> None:
        """A prop of many pieces keeps its surface if hulls of its parts are not true
        (worlds 9.4)."""
        dice = np.random.default_rng(1)
        bumpy = grid_mesh(12, 12, 1.0, dice.uniform(0, 0.3, (13, 13)))
        assert len(self.pieces(bumpy)) > 200
        small = grid_mesh(12, 12, 0.4, dice.uniform(0, 0.3, (13, 13)))
        assert len(self.pieces(small)) == 1

    def test_few_slabs_stand_for_what_is_open_and_moves(self) -> None:
        """What is not closed gets slabs if they are few, also where it moves; else a hull."""
        bumpy = grid_mesh(3, 3, 1.0, np.random.default_rng(1).uniform(0, 0.5, (4, 4)))
        assert len(self.pieces(bumpy, movable=True)) == 18
        bumpy = grid_mesh(6, 6, 1.0, np.random.default_rng(1).uniform(0, 0.5, (7, 7)))
        assert len(self.pieces(bumpy, movable=True)) == 1

    def test_a_room_within_walls_is_not_filled(self) -> None:
        """A hollow block, whose inner skin looks inwards, is walls and no block."""
        shell = joined(
            cuboid_mesh((0, 0, 0), (4, 4, 3)),
            cuboid_mesh((0.2, 0.2, 0.2), (3.8, 3.8, 2.8), inward=True),
        )
        assert len(self.pieces(shell)) == 12

    def test_flat_hulls_become_plates(self) -> None:
        """Points in one plane have no hull; a plate stands for them (worlds 59)."""
        piece = hull_piece(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]))
        assert isinstance(piece, BoxPiece)
        assert sorted(piece.half) == pytest.approx([0.0005, 0.5, 0.5])

    def test_round_hulls_have_few_corners(self) -> None:
        """A ball of thousands of points becomes a hull of at most 128, nearly as large."""
        dice = np.random.default_rng(0).normal(size=(5000, 3))
        piece = hull_piece(dice / np.linalg.norm(dice, axis=1)[:, None])
        assert isinstance(piece, HullPiece)
        assert len(piece.points) <= 128
        assert volumes([piece])[0] > 0.9 * 4 / 3 * np.pi


class TestTerrain:
    """Rolling ground."""

    def rolling(self, cells: int) -> Mesh:
        """Hills without two coplanar neighbours."""
        x, y = np.meshgrid(np.linspace(0, 20, cells + 1), np.linspace(0, 20, cells + 1))
        return grid_mesh(cells, cells, 40.0, np.sin(x * 0.7) + np.cos(y * 0.9) + 0.05 * x * y / 20)

    def test_rolling_ground_becomes_a_height_field(self) -> None:
        """Heights agree with the mesh, and the grid is as fine as its triangles (worlds 63)."""
        mesh = self.rolling(120)
        field = as_terrain(orient(soup_of(mesh), UP), UP)
        assert field.heights.shape == (121, 121)
        assert field.spacing == pytest.approx((40 / 120, 40 / 120))
        corners = field.triangles().reshape(-1, 3)
        assert corners.min(axis=0)[:2] == pytest.approx((-20.0, -20.0))
        heights = np.zeros((121, 121))
        columns, rows = np.round((corners[:, :2] + 20.0) * 3.0).astype(int).T
        heights[rows, columns] = corners[:, 2]
        inner = heights[1:-1, 1:-1] - mesh.vertices[:, 2].reshape(121, 121)[1:-1, 1:-1]
        assert np.abs(inner).max() < 0.02

    def test_ragged_ground_is_true_too(self) -> None:
        """Of 5 000 triangles ragged ground becomes a height field of the mesh's own grid, cut the
        way its squares are; of whatever cannot be true none is made."""
        ragged = grid_mesh(50, 50, 40.0, np.random.default_rng(2).uniform(0, 0.4, (51, 51)))
        for mesh in (ragged, mesh_of(ragged.vertices[:, [1, 0, 2]], ragged.triangles[:, ::-1])):
            field = as_terrain(orient(soup_of(mesh), UP), UP)
            assert field.heights.shape == (51, 51)
        askew = ragged.vertices.copy()
        askew[:, :2] += np.random.default_rng(3).uniform(-0.3, 0.3, (len(askew), 2))
        assert as_terrain(orient(soup_of(mesh_of(askew, ragged.triangles)), UP), UP) is None

    def test_small_and_flat_meshes_are_not_rolling(self) -> None:
        """Few triangles, or a floor that slabs do better, stay as they are."""
        assert is_rolling(soup_of(self.rolling(120)))
        assert not is_rolling(soup_of(self.rolling(20)))
        assert not is_rolling(soup_of(grid_mesh(120, 120, 40.0)))
