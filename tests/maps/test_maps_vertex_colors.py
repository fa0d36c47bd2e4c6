"""Colours of triangles become few materials of plain colours."""

from __future__ import annotations

import numpy as np
import pytest

from usarsim_maps.meshes.vertex_colors import MOST, shaded
from usarsim_maps.scene import Material


def test_few_colours_stay_as_they_are() -> None:
    """Up to 64 colours are kept to the 255th part, in the order of their numbers."""
    colors = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.4, 0.4, 0.4]])
    materials, slots = shaded(colors)
    assert [material.name for material in materials] == [
        "color_0000ff", "color_666666", "color_ff0000"
    ]  # fmt: skip
    found = np.array([materials[slot].color for slot in slots])
    np.testing.assert_allclose(found[:, :3], colors, atol=0.002)


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_many_colours_become_few(channels: int) -> None:
    """Of 20,000 colours at most 64 stay; greys stay finer than all colours of the rainbow."""
    values = np.random.default_rng(1).uniform(size=(20_000, channels))
    colors = np.repeat(values, 3, axis=1) if channels == 1 else values
    materials, slots = shaded(colors)
    assert 1 < len({material.name for material in materials}) == len(materials) <= MOST
    found = np.array([materials[slot].color for slot in slots])[:, : colors.shape[1]]
    most = {1: 0.02, 3: 0.17, 4: 0.5}[channels]
    assert np.abs(found - colors)[:, :3].max() <= most


def test_opacity_and_base() -> None:
    """Colours multiply those of a material; its picture stays; hardly clear is not gone."""
    base = Material("Glass", (0.5, 1.0, 1.0, 0.5), image=b"picture")
    (plain, clear), slots = shaded(np.array([[1.0, 0.0, 1.0, 0.4], [1, 1, 1, 1]]), base)[0], [0]
    assert slots == [0]
    assert (plain.name, plain.image) == ("Glass_ff00ff66", b"picture")
    assert plain.color == pytest.approx((0.5, 0.0, 1.0, 0.2))
    assert clear is base
    many = np.random.default_rng(2).uniform(0.01, 1.0, size=(5000, 4))
    assert all(material.color[3] > 0.0 for material in shaded(many)[0])


def test_numbers_that_make_no_sense() -> None:
    """What is no number is 0, what is too large is 1; no triangles give no materials."""
    (material,), _ = shaded(np.array([[np.nan, 7.0, -1.0]]))
    assert material.color == (0.0, 1.0, 0.0, 1.0)
    assert shaded(np.zeros((0, 3)))[0] == []
