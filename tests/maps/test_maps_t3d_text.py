"""The grammar of T3D, and what is refused (worlds reference 4.1, item 73)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_samples import read as read_file
from mesh_samples import write
from t3d_maps import level, room, start
from t3d_maps import read_level as read

from usarsim_maps.unreal.grammar import Block, T3dError, parse, reference, value_of
from usarsim_server.base.errors import MapImportError


def outcome(text: str) -> Block | int:
    """The blocks of a text, or the line (from 1) at which it is refused."""
    try:
        return parse(text)
    except T3dError as error:
        return error.line


LINES = [
    "Begin Map",
    "End Map",
    "Begin Actor Class=Brush Name=B",
    "End Actor",
    "End",
    "Begin Polygon",
    "End Polygon",
    "Vertex 1,2,3",
    "X=(Y=(",
    "Begin",
    "CsgOper=CSG_Add",
]


class TestGrammar:
    """Blocks and values."""

    def test_spelling_does_not_matter(self, tmp_path: Path) -> None:
        """Line ends, capitals and a missing final newline change nothing (worlds 13)."""
        text = level(room(), start("S", (10, 20, 60), "Door", 8192))
        plain = read(tmp_path, text)
        variants = [
            text.replace("\n", "\r\n"),
            text.rstrip("\n"),
            text.replace("Begin", "BEGIN")
            .replace("Vertex", "vertex")
            .replace("CsgOper", "CSGOPER"),
            text.replace("\n", "\n\t  "),
            "\ufeff" + text,
        ]
        for variant in variants:
            scene = read(tmp_path, variant)
            assert scene.starts == plain.starts
            for one, other in zip(scene.brushes, plain.brushes, strict=True):
                for a, b in zip(one.polygons, other.polygons, strict=True):
                    np.testing.assert_array_equal(a.vertices, b.vertices)

    def test_utf16_is_read(self, tmp_path: Path) -> None:
        """Newer editors write UTF-16."""
        path = write(tmp_path, level(room()).encode("utf-16"), "map.t3d")
        assert len(read_file(path).brushes) == 1

    @pytest.mark.parametrize(
        ("text", "value"),
        [
            ("12", "12"),
            ('"a b"', "a b"),
            ("(X=1,Y=-2.5)", {"x": "1", "y": "-2.5"}),
            (
                "(Scale=(X=2.0),SheerAxis=SHEER_ZX)",
                {"scale": {"x": "2.0"}, "sheeraxis": "SHEER_ZX"},
            ),
            ("()", {}),
        ],
    )
    def test_values(self, text: str, value: object) -> None:
        """Words, texts and nested structs."""
        assert value_of(text) == value

    def test_missing_members_have_their_default(self) -> None:
        """A vector without Y has Y = 0; a scale has 1."""
        block = Block("", 0, properties={"a": "(X=5,Z=1)", "b": "(X=5)", "c": "nonsense"})
        assert block.vector("a") == (5.0, 0.0, 1.0)
        assert block.vector("b", 1.0) == (5.0, 1.0, 1.0)
        assert block.vector("c") == (0.0, 0.0, 0.0)

    def test_references(self) -> None:
        """`Class'Path'` is the path, None is nothing."""
        assert reference("StaticMesh'Pkg.Group.Desk'") == "Pkg.Group.Desk"
        assert reference("None") == ""

    @given(st.text())
    def test_any_text_is_read_or_refused(self, text: str) -> None:
        """The parser gives blocks or one error with a line, never anything else."""
        assert outcome(text)

    @given(st.lists(st.sampled_from(LINES)))
    def test_any_order_of_lines(self, lines: list[str]) -> None:
        """Lines of the format in any order are read or refused."""
        assert outcome("\n".join(lines))


class TestErrors:
    """Bad files."""

    def test_a_file_cut_in_the_middle(self, tmp_path: Path) -> None:
        """Wherever a level is cut off, the error names file and line (worlds 73)."""
        text = level(room(), start("S", (0, 0, 60)))
        lines = text.splitlines()
        for count in range(1, len(lines) - 1):
            with pytest.raises(MapImportError, match=r"map\.t3d: line \d+: .*ends inside"):
                read(tmp_path, "\n".join(lines[:count]))

    def test_blocks_that_cross(self, tmp_path: Path) -> None:
        """An outer block that ends first is told with both lines."""
        with pytest.raises(MapImportError, match=r"line 3: `End Map` comes before .* of line 2"):
            read(tmp_path, "Begin Map\nBegin Actor Class=X\nEnd Map\nEnd Actor\n")

    def test_nesting_is_bounded(self, tmp_path: Path) -> None:
        """A million open blocks are refused at the sixty-fifth."""
        with pytest.raises(MapImportError, match="nested more than"):
            read(tmp_path, "Begin Map\n" * 100_000)
