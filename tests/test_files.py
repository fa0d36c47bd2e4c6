"""Which files may be read, and reading them: pipes, devices, links, impossible names."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from usarsim_server.base.errors import MapImportError, SettingsError, UsarsimError, WorldError
from usarsim_server.base.files import Folders, is_regular, open_regular, read_regular
from usarsim_server.base.toml import MAX_DEPTH, read_toml
from usarsim_server.options import load_settings

PIECES = st.sampled_from(
    [
        "..",
        ".",
        "in",
        "out",
        "link",
        "secret.txt",
        "a.txt",
        "",
        "%2e%2e",
        "..\\..",
        "C:",
        "\0",
        "x" * 300,
    ]
)


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """`in/` with a file and links that lead out, `out/` with a secret."""
    (tmp_path / "in").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "in" / "a.txt").write_text("fine")
    (tmp_path / "out" / "secret.txt").write_text("secret")
    (tmp_path / "in" / "link").symlink_to(tmp_path / "out")
    (tmp_path / "in" / "secret.txt").symlink_to(tmp_path / "out" / "secret.txt")
    return tmp_path


class TestFolders:
    def test_inside_is_what_lies_there_once_links_are_followed(self, place: Path) -> None:
        """`..`, links and absolute paths do not lead out; a link that leads in does no harm."""
        folders = Folders([place / "in"])
        (place / "out" / "back").symlink_to(place / "in")
        assert folders.admit(place / "in" / "a.txt")
        assert folders.admit(place / "in")
        assert folders.admit(place / "out" / "back" / "a.txt")
        assert folders.admit(place / "out" / ".." / "in" / "a.txt")
        for path in (
            "in/../out/secret.txt",
            "in/secret.txt",
            "in/link/secret.txt",
            "inside",
            "in/\0",
        ):
            assert not folders.admit(place / path), path
        assert not folders.admit(Path("/etc/passwd"))

    def test_a_folder_may_itself_be_a_link(self, place: Path) -> None:
        """Whoever gives a link as a folder means what it leads to."""
        assert Folders([place / "in" / "link"]).admit(place / "out" / "secret.txt")

    def test_everything_may_be_read_if_the_user_says_so(self, place: Path) -> None:
        """`--allow-outside`."""
        assert Folders([place / "in"], allow_outside=True).admit(Path("/etc/passwd"))

    def test_a_refusal_names_the_file_and_who_asks(self, place: Path) -> None:
        """One line for a report."""
        folders = Folders([place / "in"])
        said = folders.refusal(place / "out" / "secret.txt", place / "in" / "map.world")
        assert said is not None
        assert "map.world asks for" in said
        assert "secret.txt" in said
        assert folders.refusal(place / "in" / "a.txt", place / "in" / "map.world") is None

    @settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(parts=st.lists(PIECES, max_size=8))
    def test_no_path_reads_the_secret(self, place: Path, parts: list[str]) -> None:
        """Whatever is admitted can be opened without meeting what lies outside."""
        path = place / "in" / "/".join(parts)
        if not Folders([place / "in"]).admit(path):
            return
        try:
            assert read_regular(path) == b"fine"
        except OSError:
            assert not is_regular(path)


class TestRegularFiles:
    def test_nothing_else_is_opened(self, tmp_path: Path) -> None:
        """To open a pipe is to wait for a writer; a device may have no end."""
        os.mkfifo(tmp_path / "pipe")
        with socket.socket(socket.AF_UNIX) as server:
            server.bind(str(tmp_path / "socket"))
            for path, kind in (
                (tmp_path / "pipe", "a named pipe"),
                (tmp_path / "socket", "a socket"),
                (tmp_path, "a folder"),
                (Path("/dev/zero"), "a device"),
                (Path("/" + "a" * 5000), "too long"),
                (Path("a\0b"), "no file can have this name"),
                (tmp_path / "nowhere", "No such file"),
            ):
                with pytest.raises(OSError, match=kind):
                    open_regular(path)
                assert not is_regular(path)

    def test_files_are_read_up_to_a_bound(self, tmp_path: Path) -> None:
        """A longer one is an error, not a large memory."""
        path = tmp_path / "a"
        path.write_bytes(b"12345")
        assert read_regular(path, 5) == b"12345"
        with pytest.raises(OSError, match="larger than"):
            read_regular(path, 4)


BAD_TOML = [
    ("x = " + "9" * 4400, "too many digits", "line 1"),
    ("a = 1\nx = 0x" + "f" * 4400, "far too large", "line 2"),
    ("a = 1\nx = " + "[" * 3000 + "]" * 3000, "valid TOML|nested", ""),
    ("x = " + "[" * 100 + "]" * 100, "nested too deeply", "line 1"),
    ("x = " + "{a=" * 100 + "1" + "}" * 100, "nested too deeply", "line 1"),
    ("x = " + "{a=" * 3000, "valid TOML", ""),
    (".".join(["a"] * 100_000) + " = 1", "a key of too many parts", "line 1"),
    ("\n[" + " . ".join(['"a"'] * 100_000) + "]", "a key of too many parts", "line 2"),
    ("\0", "valid TOML", ""),
]


@pytest.mark.parametrize(("text", "problem", "line"), BAD_TOML)
def test_absurd_toml_is_one_error(tmp_path: Path, text: str, problem: str, line: str) -> None:
    """File, line and cure; no traceback, no minutes. The settings file goes the same way."""
    path = tmp_path / "a.toml"
    path.write_text(text)
    for read in (lambda: read_toml(path, WorldError), lambda: load_settings({}, path)):
        with pytest.raises((WorldError, SettingsError), match=problem) as caught:
            read()
        assert str(caught.value).startswith(f"{path}: {line}")
        assert len(str(caught.value)) < 500


def test_ordinary_toml_is_as_before(tmp_path: Path) -> None:
    """Dates, floats, nesting, long texts with dots."""
    path = tmp_path / "a.toml"
    depth = MAX_DEPTH - 2
    dots = "a.b." * 100
    path.write_bytes(
        f"\ufeffx = {'[' * depth}{']' * depth}\r\ny = 9223372036854775807\r\n".encode()
        + f'# {dots[:60]}\r\nz = "One. Two and three. {"word " * 90}. Four."\r\n'.encode()
    )
    assert read_toml(path, WorldError)["y"] == 2**63 - 1


@pytest.mark.parametrize("error", [WorldError, MapImportError, SettingsError])
def test_what_is_no_file_is_one_error(tmp_path: Path, error: type[UsarsimError]) -> None:
    """Folders, pipes and files that are not UTF-8 in place of TOML."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "latin").write_bytes(b"\xff\xfe")
    for path, problem in (
        (tmp_path, "folder"),
        (tmp_path / "pipe", "pipe"),
        (tmp_path / "latin", "UTF-8"),
    ):
        with pytest.raises(error, match=problem):
            read_toml(path, error)
