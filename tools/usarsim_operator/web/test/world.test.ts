import assert from "node:assert/strict";
import { test } from "node:test";
import { ball } from "../src/air";
import { gathered } from "../src/lines";
import type { LineRow } from "../src/protocol";
import { type SceneFile, World } from "../src/scene";

const box = { shape: "box" as const, size: [0.3, 0.2, 0.1], material: 0 };
const grey = { rgba: [0.5, 0.5, 0.5, 1] };

function file(generation: number, names: string[], whole: boolean): SceneFile {
  return {
    generation,
    epoch: "e",
    since: whole ? null : "e.1",
    scene: whole
      ? {
          lower: [-5, -5, 0],
          upper: [5, 5, 3],
          materials: [grey],
          still: [{ geoms: [box] }],
          bodies: [],
        }
      : null,
    kinds: whole ? { P3AT: { materials: [grey], bodies: [{ geoms: [box] }] } } : {},
    meshes: {},
    textures: {},
    present: {
      generation,
      count: names.length,
      things: names.map((name, i) => ({ id: i, what: "robot", name, kind: "P3AT", first: i })),
    },
  };
}

test("CON-06: a robot that joins is placed out of what the page has already", () => {
  const world = new World(() => {});
  world.take(file(1, ["R1"], true));
  const [still] = world.group.children.filter((one) => one.children.length === 1);
  world.take(file(2, ["R1", "R2"], false));
  assert.ok(still && world.group.children.includes(still), "what stands still is kept");
  assert.equal(world.version, "e.2");
  const poses = new Float32Array([0, 0, 0, 1, 0, 0, 0, 2, 3, 0.5, 1, 0, 0, 0]);
  assert.equal(world.place(1, poses, 1), 0);
  assert.equal(world.place(2, poses, 1), 2);
  assert.deepEqual(world.pose(world.robots.get("R2") ?? -1).elements.slice(12, 15), [2, 3, 0.5]);
  assert.equal(world.place(2, poses.slice(), 2), 1, "nothing moved: no frame is drawn");
});

test("smoke that rises is at the bottom at first and at the top at the end of its life", () => {
  const cloud = {
    pos: [1, 2, 3],
    size: [2, 2, 4],
    radius: 0.1,
    lifetime: 8,
    angle: [0],
    aside: [1],
  };
  assert.deepEqual(ball(cloud, 0, 1, 0).toArray(), [1.25, 2, 1]);
  assert.ok(Math.abs(ball(cloud, 0, 1, 7.9999).z - 5) < 0.01);
});

test("lines that repeat are one row with their count, the newest first", () => {
  const row = (time: number, text: string): LineRow => ({
    time,
    text,
    direction: "in",
    reading: null,
    effect: "carried out",
    fault: null,
  });
  const rows = [row(1, "A"), row(2, "A"), row(3, "SEN x"), row(4, "A"), row(5, "B")];
  const found = gathered(rows, (one) => !one.text.startsWith("SEN"));
  assert.deepEqual(
    found.map(({ row: { text, time }, count }) => [text, time, count]),
    [
      ["B", 5, 1],
      ["A", 4, 3],
    ],
  );
});
