"""What a Gazebo world says and the simulation has no use for is counted, by kind and name."""

from __future__ import annotations

from pathlib import Path

import pytest
from mesh_samples import read
from sdf_samples import BOX, load, model, sdf, world, write

from usarsim_maps.findings import Findings
from usarsim_maps.gazebo.elements import TABLES
from usarsim_maps.support import Support, SupportTable

UNIT_BOX = "<box><size>1 1 1</size></box>"

PLACES = {
    "SDF root elements": sdf(f"{{}}{model('m', BOX)}"),
    "SDF world elements": world(f"{{}}{model('m', BOX)}"),
    "SDF include elements": world(
        f"<include><uri>model://gone</uri>{{}}</include>{model('m', BOX)}"
    ),
    "SDF model elements": world(f'<model name="m">{{}}<link name="l">{BOX}</link></model>'),
    "SDF link elements": world(model("m", "{}" + BOX)),
    "SDF inertial elements": world(model("m", f"<inertial>{{}}</inertial>{BOX}")),
    "SDF visual elements": world(
        model("m", f'<visual name="v"><geometry>{UNIT_BOX}</geometry>{{}}</visual>')
    ),
    "SDF collision elements": world(
        model("m", f'<collision name="v"><geometry>{UNIT_BOX}</geometry>{{}}</collision>')
    ),
    "SDF surface elements": world(
        model("m", f"<collision><surface>{{}}</surface></collision>{BOX}")
    ),
    "SDF friction elements": world(
        model("m", f"<collision><surface><friction>{{}}</friction></surface></collision>{BOX}")
    ),
    "SDF contact elements": world(
        model("m", f"<collision><surface><contact>{{}}</contact></surface></collision>{BOX}")
    ),
    "SDF geometries": world(model("m", f"<visual><geometry>{{}}</geometry></visual>{BOX}")),
    "SDF mesh elements": world(
        model("m", f"<visual><geometry><mesh><uri>a.obj</uri>{{}}</mesh></geometry></visual>{BOX}")
    ),
    "SDF heightmap elements": world(
        model("m", f"<visual><geometry><heightmap>{{}}</heightmap></geometry></visual>{BOX}")
    ),
    "SDF material elements": world(
        model("m", f"<visual><geometry>{UNIT_BOX}</geometry><material>{{}}</material></visual>")
    ),
    "SDF light elements": world(f'<light name="s" type="point">{{}}</light>{model("m", BOX)}'),
    "SDF joint elements": world(
        f'<model name="m"><link name="link">{BOX}</link><joint name="j" type="fixed">'
        "<parent>world</parent><child>link</child>{}</joint></model>"
    ),
    "SDF population elements": world(f"<population>{{}}</population>{model('m', BOX)}"),
    "SDF state elements": world(f"{model('m', BOX)}<state>{{}}</state>"),
    "SDF model state elements": world(
        f'{model("m", BOX)}<state><model name="m">{{}}</model></state>'
    ),
    "SDF link state elements": world(
        f'{model("m", BOX)}<state><model name="m"><link name="link">{{}}</link></model></state>'
    ),
    "SDF light state elements": world(
        f'{model("m", BOX)}<state><light name="s">{{}}</light></state>'
    ),
    "URDF robot elements": "<robot>{}</robot>",
    "URDF link elements": '<robot><link name="a">{}</link></robot>',
    "URDF inertial elements": '<robot><link name="a"><inertial>{}</inertial></link></robot>',
    "URDF visual and collision elements": (
        '<robot><link name="a"><visual>{}</visual></link></robot>'
    ),
    "URDF geometries": (
        '<robot><link name="a"><visual><geometry>{}</geometry></visual></link></robot>'
    ),
    "URDF material elements": (
        '<robot><link name="a"><visual><geometry><box size="1 1 1"/></geometry>'
        "<material>{}</material></visual></link></robot>"
    ),
    "URDF joint elements": (
        '<robot><link name="a"/><link name="b"/><joint name="j" type="fixed"><parent link="a"/>'
        '<child link="b"/>{}</joint></robot>'
    ),
    "URDF gazebo elements": '<robot><link name="a"/><gazebo>{}</gazebo></robot>',
}
"""A file for each list, with a gap where its elements stand."""


IT_DEPENDS = {
    ("SDF world elements", "gravity"),
    *(("SDF state elements", tag) for tag in ("model", "model_state", "light", "light_state")),
    *(("SDF model state elements", tag) for tag in ("model", "model_state", "link", "link_state")),
}
"""Are counted where gravity is another one than the server's, and what a state cannot place."""


@pytest.mark.parametrize(("title", "table"), TABLES.items())
def test_tables_are_acted_by(tmp_path: Path, title: str, table: SupportTable) -> None:
    """Elements are counted if their table, or no table, says that they are left out."""
    for tag, support in [*table.items(), ("novelty", Support.LEFT_OUT)]:
        if support is Support.REFUSED:
            continue
        findings = Findings()
        text = PLACES[title].replace("{}", f'<{tag} name="thing">some</{tag}>')
        read(write(tmp_path, text), findings)
        counted = sum(
            number
            for kind, number in findings.skipped.items()
            if kind.split()[-1] == tag and findings.skipped_names.get(kind) == ["thing"]
        )
        told = support is Support.LEFT_OUT
        if tag in ("population", "include", "world") or (title, tag) in IT_DEPENDS:
            continue
        assert counted == told, (title, tag, findings.skipped, findings.skipped_names)


def test_what_says_nothing_does_not_count(tmp_path: Path, findings: Findings) -> None:
    """Elements that are empty, or say what holds anyway, are no news."""
    text = (
        "<self_collide>0</self_collide><enable_wind>false</enable_wind><gravity>1</gravity>"
        "<velocity_decay/>"
    )
    load(tmp_path, model("m", text + BOX) + "<wind/>", findings)
    assert not findings.skipped
    load(tmp_path, model("m", "<gravity>0</gravity>" + BOX), findings)
    assert findings.skipped == {"gravity": 1}


def test_names_of_what_is_left_out(tmp_path: Path, findings: Findings) -> None:
    """Sensors, plug-ins and actors are counted with their names; plug-ins with starts are read."""
    sensors = '<sensor name="eye" type="camera"/><sensor name="ear" type="x"/>'
    text = (
        model("m", sensors + BOX) + '<plugin name="drive" filename="x.so"/><actor name="walker"/>'
        '<plugin name="s" filename="y.so"><StartPose_1>A 1,2,3 0,0,0</StartPose_1></plugin>'
    )
    load(tmp_path, text, findings)
    assert findings.skipped == {"sensor": 2, "plugin": 1, "actor": 1}
    assert findings.skipped_names["sensor"] == ["eye", "ear"]


def test_second_worlds_and_shapes(tmp_path: Path, findings: Findings) -> None:
    """Of two worlds, and of two shapes in one geometry, the first is read."""
    two = UNIT_BOX + "<sphere><radius>1</radius></sphere>"
    inner = model("m", f'<visual name="v"><geometry>{two}</geometry></visual>')
    text = sdf(f'<world name="a">{inner}</world><world name="b"/>')
    read(write(tmp_path, text), findings)
    assert findings.skipped == {"geometry sphere": 1, "world": 1}


def test_other_gravity(tmp_path: Path, findings: Findings) -> None:
    """The gravity of a world is counted where it differs from the server's."""
    load(tmp_path, model("m", BOX) + "<gravity>0 0 -9.8</gravity>", findings)
    assert not findings.skipped
    load(tmp_path, model("m", BOX) + "<gravity>0 0 -1.6</gravity>", findings)
    assert findings.skipped == {"gravity": 1}
