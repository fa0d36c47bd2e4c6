"""Pictures by their content, from OpenGL and from rays alike."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from camera_fakes import (
    FOV,
    HEIGHT,
    MAST,
    RED_BOX,
    WIDTH,
    Geom,
    MakePainter,
    Yard,
    camera,
    cart,
    darken,
    is_red,
    seen,
)
from numpy.typing import NDArray

from usarsim_server.cameras.gl import GlBackend
from usarsim_server.cameras.painter import Painter, PainterOptions
from usarsim_server.cameras.view import View, looking
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import RobotModel
from usarsim_server.simulation.rays.query import RayFan
from usarsim_server.worlds.description import Smoke, SmokeVolume


def test_a_box_is_where_geometry_puts_it(yard: Yard, make_painter: MakePainter) -> None:
    """The near face of a box of 1 m appears as large and as high as a pinhole camera shows it."""
    robot = yard.park(0.0, 0.0)
    red = is_red(seen(make_painter(), yard, robot))
    rows, columns = np.nonzero(red)
    focal = WIDTH / 2 / math.tan(FOV / 2)
    distance = RED_BOX[0] - 0.5 - MAST.position[0]
    assert columns.max() - columns.min() + 1 == pytest.approx(focal / distance, abs=1.5)
    assert columns.mean() == pytest.approx((WIDTH - 1) / 2, abs=0.5)
    top = HEIGHT / 2 - focal * (1.0 - 0.5) / distance
    assert rows.min() == pytest.approx(top, abs=1.5)


def test_the_picture_turns_with_the_robot(yard: Yard, make_painter: MakePainter) -> None:
    """A turn to the left moves the box to the right, half a turn takes it out of the picture."""
    robot, painter = yard.park(0.0, 0.0), make_painter()
    yard.turn(robot, 0.0, 0.0, 0.2)
    moved = np.nonzero(is_red(seen(painter, yard, robot)))[1].mean()
    focal = WIDTH / 2 / math.tan(FOV / 2)
    assert moved == pytest.approx(WIDTH / 2 + focal * math.tan(0.2), abs=3.0)
    yard.turn(robot, 0.0, 0.0, math.pi)
    assert not is_red(seen(painter, yard, robot)).any()


def test_a_robot_is_seen_by_another(yard: Yard, make_painter: MakePainter) -> None:
    """Robots appear in each other's pictures, in their own colours, where they are."""
    robot, painter = yard.park(0.0, 0.0), make_painter()
    yard.park(2.0, 0.8, model=cart("pink", (0.9, 0.2, 0.9)))
    picture = seen(painter, yard, robot).astype(int)
    pink = (picture[..., 0] > 2 * picture[..., 1]) & (picture[..., 2] > 2 * picture[..., 1])
    columns = np.nonzero(pink)[1]
    assert columns.size > 100
    assert columns.max() < WIDTH / 2  # to the left


def test_the_first_row_is_the_top(yard: Yard, make_painter: MakePainter) -> None:
    """The sky is in the first rows, the floor in the last (side channels 16)."""
    robot = yard.park(0.0, 0.0)
    picture = seen(make_painter(), yard, robot).astype(int)
    assert (picture[0, :, 2] > 2 * picture[0, :, 0]).all()
    low = picture[-1]
    assert (np.abs(low - low.mean(axis=1, keepdims=True)) < 12).all()  # grey


def test_zoom_narrows_the_picture(yard: Yard, make_painter: MakePainter) -> None:
    """With half the slope the box is twice as wide (side channels 45)."""
    robot, painter = yard.park(0.0, 0.0), make_painter()

    def width(fov: float) -> float:
        columns = np.nonzero(is_red(seen(painter, yard, robot, fov=fov)))[1]
        return float(columns.max() - columns.min() + 1)

    narrow = 2 * math.atan(math.tan(FOV / 2) / 2)
    assert width(narrow) == pytest.approx(2 * width(FOV), abs=3.0)


def test_a_camera_goes_with_its_link(yard: Yard, make_painter: MakePainter) -> None:
    """A camera on a head looks where the head is turned."""
    robot, painter = yard.park(0.0, 0.0), make_painter()
    ahead = seen(painter, yard, robot, link="head", pose=Pose((0.1, 0.0, 0.1)))
    assert is_red(ahead).any()
    engine = yard.simulation._engine
    layout = yard.look().layouts[robot]
    engine.data.qpos[layout.joint_qpos["pan"]] = math.pi / 2
    aside = seen(painter, yard, robot, link="head", pose=Pose((0.1, 0.0, 0.1)))
    assert not is_red(aside).any()
    green = aside.astype(int)
    assert ((green[..., 1] > 2 * green[..., 0]) & (green[..., 1] > 2 * green[..., 2])).any()


def test_a_camera_inside_its_housing_sees_out(yard: Yard, make_painter: MakePainter) -> None:
    """The shell around a camera does not fill its picture: shells are seen from outside only."""
    robot = yard.park(0.0, 0.0)
    inside = seen(make_painter(), yard, robot, pose=Pose((0.2, 0.0, 0.05)))
    assert is_red(inside).sum() > 200


def test_own_parts_are_seen(yard: Yard, make_painter: MakePainter) -> None:
    """What stands before a camera is seen though it is its own robot's, as in the original."""
    robot = yard.park(0.0, 0.0)
    back = Pose((-0.6, 0.0, 0.3))
    picture = seen(make_painter(), yard, robot, pose=back).astype(int)
    yellow = (picture[..., 0] > 2 * picture[..., 2]) & (picture[..., 1] > 2 * picture[..., 2])
    assert yellow.any()


def test_parked_robots_are_not_drawn(yard: Yard, make_painter: MakePainter) -> None:
    """A robot that has left is not seen, neither where it was nor where it is kept."""
    painter, robot = make_painter(), yard.park(0.0, 0.0)
    other = yard.park(2.0, 0.0, model=cart("pink", (0.9, 0.2, 0.9)))
    before = seen(painter, yard, robot)
    yard.simulation.remove(other)
    yard.simulation.settle()
    assert (seen(painter, yard, robot) != before).any()
    slot = next(s for s, one in enumerate(yard.simulation._engine.world.slots) if one.key == "pink")
    x, y, z = yard.simulation._engine.world.parking[slot, :3].tolist()
    shelf = View(looking((x - 2.0, y, z + 1.0), (x, y, z)), width=80, height=60, mode="depth")
    assert np.isinf(painter.picture(shelf, yard.look())).all()


def test_equal_snapshots_give_equal_pictures(yard: Yard, make_painter: MakePainter) -> None:
    """A picture depends on the snapshot and the eye only, whatever was drawn before."""
    robot = yard.park(0.5, 0.3, 0.1)
    one, other = make_painter(), make_painter()
    first = seen(one, yard, robot)
    seen(one, yard, robot, fov=0.5)
    assert np.array_equal(seen(one, yard, robot), first)
    assert np.array_equal(seen(other, yard, robot), first)


def test_pictures_survive_the_growth_of_the_model(yard: Yard, make_painter: MakePainter) -> None:
    """A class that is new to the world changes the model, not what is seen beside it."""
    robot, painter = yard.park(0.0, 0.0), make_painter()
    before = seen(painter, yard, robot)
    generation = yard.look().generation
    newcomer = yard.park(-5.0, 0.0, model=cart("pink", (0.9, 0.2, 0.9)))
    assert yard.look().generation > generation
    assert np.array_equal(seen(painter, yard, robot), before)
    yard.turn(newcomer, 2.0, -0.8, 0.0)
    assert (seen(painter, yard, robot) != before).any()


def test_growth_loads_nothing_twice(yard: Yard, gl: str) -> None:
    """The context of OpenGL, whose making holds up all threads, is kept if assets are the same."""
    painter = Painter(yard.simulation.compiled, PainterOptions(renderer=gl))
    robot = yard.park(0.0, 0.0)
    seen(painter, yard, robot)
    backend = painter._backend
    assert isinstance(backend, GlBackend)
    kept = backend._renderer
    yard.park(2.0, 0.8, model=cart("pink", (0.9, 0.2, 0.9)))
    seen(painter, yard, robot)
    assert backend._renderer is kept
    yard.park(2.0, -1.0, model=RobotModel("wedge", _wedge, (), rest_height=0.1, anchored=True))
    seen(painter, yard, robot)
    assert backend._renderer is not kept
    painter.close()


def test_glass_can_be_looked_through(make_painter: MakePainter) -> None:
    """Behind a pane of glass the box is seen."""
    house = Yard(_glaze)
    robot = house.park(0.0, 0.0)
    picture = seen(make_painter(of=house), house, robot).astype(int)
    rows, columns = np.nonzero(picture[..., 0] > 1.5 * picture[..., 1])
    assert rows.size > 200
    assert columns.mean() == pytest.approx(WIDTH / 2, abs=3)


def _glaze(spec: mujoco.MjSpec) -> None:
    """A pane of glass before the box."""
    spec.add_material(name="glass", rgba=[0.7, 0.8, 0.9, 0.3])
    spec.worldbody.add_geom(
        type=Geom.mjGEOM_BOX, size=[0.01, 2.0, 1.0], pos=[2.5, 0.0, 1.0], material="glass"
    )


def test_a_class_with_a_mesh_of_its_own_appears(yard: Yard, make_painter: MakePainter) -> None:
    """New meshes are loaded with the new model."""
    robot, painter = yard.park(0.0, 0.0), make_painter()
    seen(painter, yard, robot)
    yard.park(2.0, 0.0, model=RobotModel("wedge", _wedge, (), rest_height=0.1, anchored=True))
    picture = seen(painter, yard, robot).astype(int)
    cyan = (picture[..., 1] > 2 * picture[..., 0]) & (picture[..., 2] > 2 * picture[..., 0])
    assert cyan[HEIGHT // 2 :].sum() > 100


def _wedge() -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    corners = [-0.4, -0.4, 0, 0.4, -0.4, 0, 0.4, 0.4, 0, -0.4, 0.4, 0, 0.4, 0, 0.6]
    spec.add_mesh(name="wedge", uservert=corners)
    base = spec.worldbody.add_body(name="base")
    base.add_freejoint(name="free")
    base.add_geom(type=Geom.mjGEOM_MESH, meshname="wedge", mass=1.0, rgba=[0.05, 0.8, 0.8, 1.0])
    return spec


def test_depth_agrees_with_a_laser(yard: Yard, make_painter: MakePainter) -> None:
    """The depth image and the rays of range sensors differ by less than 2 cm."""
    robot, painter = yard.park(0.0, 0.0), make_painter()
    yard.park(2.0, 0.8, 0.4)
    snapshot = yard.look()
    place = painter.place(camera(robot), snapshot, WIDTH, HEIGHT)
    assert place is not None
    view = View(place.pose, place.fov, WIDTH, HEIGHT, "depth")
    depth = painter.picture(view, snapshot).astype(float)
    rays = place.rays()
    lengths = rays.lengths()
    directions = rays.directions(place.pose.matrix()) / lengths[..., None]
    fan = RayFan(np.array(place.pose.position), directions.reshape(-1, 3).astype(float), 30.0)
    (hits,) = yard.simulation.cast([fan], snapshot, None)
    measured = (depth * lengths).reshape(-1)
    both = np.isfinite(hits.distances) & (measured < 25.0)
    assert both.sum() > 8000
    # Pixels at edges may see the one or the other side.
    apart = np.abs(measured[both] - hits.distances[both]) > 0.02
    assert apart.mean() < 0.01


def test_depth_is_along_the_axis(yard: Yard, make_painter: MakePainter) -> None:
    """Depth is measured along the viewing axis: a wall across it is equally deep all over."""
    painter = make_painter()
    view = View(looking((2.5, 0.0, 0.5), (4.0, 0.0, 0.5)), 0.5, 60, 40, "depth")
    depth = painter.picture(view, yard.look())
    assert depth == pytest.approx(np.full((40, 60), 1.0), abs=0.005)


def test_segmentation_names_what_is_seen(yard: Yard, make_painter: MakePainter) -> None:
    """Numbers are those of the geoms in the model of the snapshot; sky is -1."""
    painter, snapshot = make_painter(), yard.look()
    view = View(looking((0.0, 0.0, 0.5), (4.0, 0.0, 0.5)), 1.0, 80, 60, "segmentation")
    geoms = painter.picture(view, snapshot)
    model = yard.simulation.compiled(snapshot).model
    names = {model.geom(int(geom)).name for geom in np.unique(geoms) if geom >= 0}
    assert names == {"floor", "red"}
    assert geoms[30, 40] == model.geom("red").id
    assert geoms[0, 0] == -1


class TestAgreement:
    """OpenGL and rays show the same."""

    @pytest.fixture
    def pair(self, yard: Yard, gl: str) -> tuple[Painter, Painter]:
        """One painter of each kind."""
        make = [PainterOptions(renderer=name) for name in (gl, "rays")]
        one, other = (Painter(yard.simulation.compiled, options) for options in make)
        return one, other

    @pytest.mark.parametrize(
        "place", [(0.0, 0.0, 0.5), (-2.0, -3.0, 2.0), (1.9, 0.1, 0.9), (2.0, 5.0, 1.5)]
    )
    def test_silhouettes_are_the_same(
        self, yard: Yard, pair: tuple[Painter, Painter], place: tuple[float, float, float]
    ) -> None:
        """All but pixels at edges show the same geom at the same depth in nearly the same light."""
        yard.park(2.0, 0.8, 0.4)
        yard.park(1.0, -0.8, -0.4)
        snapshot, pose = yard.look(), looking(place, (2.5, 0.4, 0.3))

        def both(mode: str) -> tuple[NDArray[np.generic], NDArray[np.generic]]:
            view = View(pose, FOV, WIDTH, HEIGHT, mode)  # type: ignore[arg-type]
            one, other = (painter.picture(view, snapshot) for painter in pair)
            return one, other

        geoms = both("segmentation")
        assert (geoms[0] != geoms[1]).mean() < 0.01
        same = geoms[0] == geoms[1]
        depths = [depth.astype(float)[same] for depth in both("depth")]
        near = np.maximum(*depths) < 20.0
        assert np.abs(depths[0][near] - depths[1][near]).max() < 0.05
        assert (np.isinf(depths[0]) == np.isinf(depths[1])).mean() > 0.999
        colors = [picture.astype(int)[same] for picture in both("rgb")]
        assert np.abs(colors[0] - colors[1]).mean() < 6.0


class TestSmoke:
    """Smoke in pictures."""

    BANK = SmokeVolume("bank", "box", Pose((2.0, 0.0, 0.0)), (1.0, 3.0, 4.0), 3.0)

    def test_fog_greys(self, yard: Yard, make_painter: MakePainter) -> None:
        """Thick haze takes the colour of a box, thin haze a part of it."""
        robot = yard.park(0.0, 0.0)
        clear = seen(make_painter(), yard, robot).astype(int)
        red = is_red(clear)
        thin = seen(make_painter(Smoke(haze=0.1)), yard, robot).astype(int)
        thick = seen(make_painter(Smoke(haze=3.0)), yard, robot).astype(int)

        def redness(picture: NDArray[np.int_]) -> float:
            return float((picture[red][:, 0] - picture[red][:, 1]).mean())

        assert redness(clear) > 80
        # 3.4 m of 0.1/m leave exp(-0.34) = 71 %.
        assert redness(thin) == pytest.approx(0.71 * redness(clear), rel=0.05)
        assert abs(redness(thick)) < 3

    def test_regional_smoke_hides_what_is_behind_it(
        self, yard: Yard, make_painter: MakePainter
    ) -> None:
        """A bank of smoke before the box hides it; nothing before the bank has changed."""
        robot = yard.park(0.0, 0.0)
        clear = seen(make_painter(), yard, robot)
        smoky = seen(make_painter(Smoke(volumes=(self.BANK,))), yard, robot)
        assert is_red(clear).any()
        assert not is_red(smoky).any()
        assert np.array_equal(clear[-8:], smoky[-8:])  # the floor before one's feet

    def test_smoke_behind_is_not_before(self, yard: Yard, make_painter: MakePainter) -> None:
        """A bank of smoke behind the box leaves the box as it was."""
        robot = yard.park(0.0, 0.0)
        behind = SmokeVolume("bank", "box", Pose((7.0, 0.0, 0.0)), (1.0, 9.0, 6.0), 3.0)
        clear = seen(make_painter(), yard, robot)
        smoky = seen(make_painter(Smoke(volumes=(behind,))), yard, robot)
        red = is_red(clear)
        assert np.array_equal(clear[red], smoky[red])
        assert (clear != smoky).any()

    def test_depth_is_not_veiled(self, yard: Yard, make_painter: MakePainter) -> None:
        """Depth and segmentation of spectators are the truth, smoke or not."""
        view = View(looking((0.0, 0.0, 0.5), (4.0, 0.0, 0.5)), 1.0, 80, 60, "depth")
        clear = make_painter().picture(view, yard.look())
        smoky = make_painter(Smoke(haze=3.0)).picture(view, yard.look())
        assert np.array_equal(clear, smoky)


class TestHeadlights:
    """`DRIVE {Light true}`."""

    def test_the_scene_ahead_is_lit(self, yard: Yard, make_painter: MakePainter) -> None:
        """The box before the robot gets brighter, the sky and the far side stay as they are."""
        robot = yard.park(1.0, 0.0)
        dark = seen(make_painter(), yard, robot).astype(int)
        lit = seen(make_painter(lit=lambda one: one == robot), yard, robot).astype(int)
        red = is_red(dark)
        assert (lit[red] - dark[red])[:, 0].mean() > 30
        assert np.array_equal(lit[0], dark[0])
        assert (lit >= dark).all()

    def test_others_see_it(self, yard: Yard, make_painter: MakePainter) -> None:
        """Another camera sees the cone on the floor, and none of it behind the robot."""
        robot = yard.park(0.0, 0.0)
        above = View(Pose((0.0, 0.0, 6.0), (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)), 1.2, 80, 80)
        dark = make_painter().picture(above, yard.look()).astype(int)
        lit = make_painter(lit=lambda one: one == robot).picture(above, yard.look()).astype(int)
        brighter = (lit - dark).sum(axis=-1) > 9
        rows = np.nonzero(brighter)[0]
        assert brighter.sum() > 50
        assert rows.max() <= 40  # ahead is up in this picture

    def test_it_lights_in_the_dark(self, make_painter: MakePainter) -> None:
        """In a world without light a lamp shows what a lit world would show."""
        night = Yard(darken)
        robot = night.park(1.0, 0.0)
        dark = seen(make_painter(of=night), night, robot)
        lit = seen(make_painter(lit=lambda one: True, of=night), night, robot)
        assert not is_red(dark).any()
        assert is_red(lit).sum() > 200
