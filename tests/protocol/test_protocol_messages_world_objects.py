"""GetSTA answers of world controllers (protocol reference 4.11; checklist 53, 54, 168, 171)."""

from __future__ import annotations

import re

from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.protocol.messages import ObjectStatus, encode, object_status

BOX = ObjectStatus(
    name="Box3",
    size=(0.3, 0.3, 0.3),
    location=(3.1, 0.2, -0.15),
    rotation=(0.0, 0.0, 0.7854),
    memory="red",
)
NUMBERS = st.floats(-1e4, 1e4)
VECTORS = st.tuples(NUMBERS, NUMBERS, NUMBERS)


def iridium(text: str) -> list[tuple[str, str]]:
    """Keys and values as a client reads them that splits at any brace (5.1.2)."""
    parts = [part for part in re.split(r"[{}]", text)[1:] if part.strip()]
    return [(key, value) for key, blank, value in (part.partition(" ") for part in parts) if blank]


def test_one_object() -> None:
    """The example of 4.11 with a positive height."""
    assert object_status([BOX]) == (
        "STA {Name Box3} {Size 0.3000,0.3000,0.3000} {Location 3.1000,0.2000,-0.1500} "
        "{Memory red} {Rotation 0.0000,0.0000,0.7854}"
    )


def test_no_object() -> None:
    """168: the bare head."""
    assert object_status([]) == "STA"


def test_several_objects_stand_in_one_line() -> None:
    """4.11: one line for all, each from its Name to its Rotation."""
    other = ObjectStatus(name="B", size=(1, 1, 1), location=(0, 0, 0), rotation=(0, 0, 0))
    text = object_status([BOX, other])
    keys = re.findall(r"\{(\w+)", text)
    assert keys == ["Name", "Size", "Location", "Memory", "Rotation"] * 2
    assert text.startswith(object_status([BOX]))


def test_sizes_are_never_negative() -> None:
    """4.11 REQ: what the original negated is positive."""
    upside_down = ObjectStatus(name="n", size=(1, 2, -3), location=(0, 0, 0), rotation=(0, 0, 0))
    assert "{Size 1.0000,2.0000,3.0000}" in object_status([upside_down])


def test_an_empty_memory_is_a_key_with_an_empty_value() -> None:
    """A client that splits key and value at the blank finds Memory in any case."""
    blank = ObjectStatus(name="n", size=(1, 1, 1), location=(0, 0, 0), rotation=(0, 0, 0))
    assert ("Memory", "") in iridium(object_status([blank]))
    assert b"{Memory }" in encode(object_status([blank]))


@given(st.text(max_size=20), st.text(max_size=20), VECTORS, VECTORS, VECTORS)
def test_braces_are_balanced_whatever_the_names(
    name: str, memory: str, size: tuple[float, ...], place: tuple[float, ...], turn: tuple[float]
) -> None:
    """171: five segments, each opened and closed, none inside another; vectors without blanks."""
    status = ObjectStatus(
        name=name,
        memory=memory,
        size=size,  # type: ignore[arg-type]
        location=place,  # type: ignore[arg-type]
        rotation=turn,  # type: ignore[arg-type]
    )
    text = encode(object_status([status])).decode("latin-1")
    assert re.fullmatch(r"STA( \{[^{}]*\}){5}\r\n", text)
    vector = r"(-?\d+\.\d{4}(,|(?=\}))){3}"
    for key in ("Size", "Location", "Rotation"):
        assert re.search(rf"\{{{key} {vector}\}}", text)
