"""What works without any extra, and the one line of what does not."""

from __future__ import annotations

import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path

import pytest
from lanes import slow_but

from usarsim_server.testing import PATIENCE, running_server

ROOT = Path(__file__).parents[1]
SITE = Path(sysconfig.get_paths()["purelib"])
SERVER = (
    "mujoco",
    "numpy",
    "embreex",
    "cv2",
    "opencv_python_headless",
    "mapbox_earcut",
    "PIL",
    "pillow",
)
"""How the files of the base dependencies begin."""
OF_MUJOCO = ("glfw", "OpenGL", "etils", "absl", "fsspec", "importlib_resources", "zipp", "typing_")
START = "from usarsim_server.__main__ import main; sys.exit(main())"


def environment(folder: Path, libraries: Sequence[str]) -> list[str]:
    """The command that runs Python with no libraries but these, and the facts of the distribution.

    Args:
        folder: gets links to them.
        libraries: how the names of their files begin.
    """
    for entry in SITE.iterdir():
        if entry.name.startswith((*libraries, "usarsim_server-")):
            (folder / entry.name).symlink_to(entry)
    paths = [str(ROOT), str(ROOT / "tools"), str(folder)]
    return [sys.executable, "-I", "-S", "-c", f"import sys; sys.path[:0] = {paths}; "]


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Python with the base dependencies alone."""
    *python, paths = environment(tmp_path_factory.mktemp("bare"), (*SERVER, *OF_MUJOCO))
    return [*python, paths + START]


@pytest.mark.parametrize(
    ("command", "library", "extra"),
    [
        ("console", "aiohttp", "console"),
        ("explore list", "psutil", "exploration"),
        ("mission check arena-search", "yaml", "missions"),
        ("study check rsarsim", "yaml", "study"),
        ("sweep runs.toml --out there", "psutil", "batch"),
    ],
)
def test_a_missing_library_is_one_line(
    command: str, library: str, extra: str, bare: list[str], tmp_path: Path
) -> None:
    done = subprocess.run(
        [*bare, *command.split()], capture_output=True, text=True, cwd=tmp_path, timeout=PATIENCE
    )
    cure = f'{library} is not installed (pip install "usarsim-server[{extra}]")'
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("error: ")
    assert done.stderr.endswith(f": {cure}\n")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("command", ["import {} --out there", "serve --port 0 --world {}"])
def test_a_map_names_its_library(command: str, bare: list[str], tmp_path: Path) -> None:
    """Also where the server itself imports the map."""
    sheet = tmp_path / "hall.yaml"
    sheet.write_text("image: hall.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n")
    words = command.format(sheet).split()
    done = subprocess.run(
        [*bare, *words], capture_output=True, text=True, cwd=tmp_path, timeout=PATIENCE
    )
    assert done.returncode == 2, done.stderr
    assert "grid maps need the Python package 'yaml'" in done.stderr
    assert done.stderr.endswith('(pip install "usarsim-server[maps]")\n')


@pytest.mark.parametrize(
    "command",
    slow_but({"worlds"}.__contains__, ["worlds", "robots P3AT", "doctor --port 0"]),
)
def test_the_base_is_enough(command: str, bare: list[str], tmp_path: Path) -> None:
    done = subprocess.run(
        [*bare, *command.split()], capture_output=True, text=True, cwd=tmp_path, timeout=PATIENCE
    )
    assert (done.returncode, done.stderr) == (0, ""), done.stdout


DRIVE = """
from usarsim_client import connect_blocking, readings
with connect_blocking("127.0.0.1", {port}) as server:
    robot = server.spawn("P3AT", "Rover", start="RobotStart1")
    robot.drive(left=1.0, right=1.0)
    for pose in robot.odometry():
        if pose.x > 0.05:
            break
    print(robot.newest(readings.GroundTruth) is not None, "mujoco" in sys.modules)
from usarsim_client import Picture
try:
    Picture(1, b"...").pixels
except ModuleNotFoundError as error:
    print(error)
"""


def test_the_client_needs_numpy_alone(tmp_path: Path) -> None:
    """It drives a robot without MuJoCo; only JPEG pictures need pillow."""
    *python, paths = environment(tmp_path, ("numpy",))
    with running_server(world="empty", speed=4.0) as (_, endpoints):
        program = DRIVE.format(port=endpoints["control"].port)
        done = subprocess.run(
            [*python, paths + program], capture_output=True, text=True, timeout=PATIENCE
        )
    assert done.stderr == ""
    assert done.stdout.splitlines() == [
        "True False",
        "JPEG pictures: pillow is not installed (pip install pillow)",
    ]
