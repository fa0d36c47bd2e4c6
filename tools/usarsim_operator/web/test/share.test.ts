import assert from "node:assert/strict";
import { test } from "node:test";
import { read } from "../src/share/packed";
import { clock, Run } from "../src/share/run";

/** A robot that goes 1 m along x in 1 s and turns round, rows every half second from 10.5 s on. */
function packed(): ArrayBuffer {
  const whole: Record<string, number[]> = {
    time: [10500, 500, 500],
    "0.x": [0, 500, 500],
    "0.y": [2000, 0, 0],
    "0.z": [0, 0, 0],
    "0.qw": [10000, -2929, -7071],
    "0.qz": [0, 7071, 2929],
    "0.left": [0, 50, 0],
    "map.index": [1, 2, -2],
  };
  const bytes: Record<string, number[]> = {
    "0.there": [1, 1, 0],
    "0.source": [0, 1, 1],
    "map.value": [1, 2, 2],
  };
  const contents = {
    began: 10.5,
    units: { place: 1e-3, turn: 1e-4, power: 1e-2, time: 1e-3 },
    robots: [{ name: "R1", class: "P3AT", modes: [[11, "autonomous"]], told: [] }],
    victims: [{ name: "Anna", pos: [1, 2, 0], found: 11, credited: 0 }],
    maps: {
      rows: 2,
      columns: 2,
      steps: [
        [10.5, 2],
        [11.2, 1],
      ],
    },
    scores: [[11, 5]],
    marks: [["1", 10.6, 11.1, 1, 2, "found"]],
    selected: [[10.6, 7, "R1"]],
    arrays: [
      ...Object.entries(whole).map(([name, values]) => [name, "i4", values.length]),
      ...Object.entries(bytes).map(([name, values]) => [name, "u1", values.length]),
    ],
  };
  let text = JSON.stringify(contents);
  text += " ".repeat((4 - (text.length % 4)) % 4);
  const parts = [
    new Uint8Array(new Uint32Array([text.length]).buffer),
    new TextEncoder().encode(text),
    ...Object.values(whole).map((values) => new Uint8Array(new Int32Array(values).buffer)),
    ...Object.values(bytes).map((values) => Uint8Array.from([...values, 0])),
  ];
  const data = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
  parts.reduce((at, part) => {
    data.set(part, at);
    return at + part.length;
  }, 0);
  return data.buffer;
}

test("a shared run is where it was: rows, and straight ways between them", () => {
  const run = new Run(read(packed()));
  assert.deepEqual([run.begin, run.end], [0, 1]);
  assert.deepEqual(run.pose(0, 0)?.slice(0, 3), [0, 2, 0]);
  const [x = 0, , , w = 0, , , z = 0] = run.pose(0, 0.25) ?? [];
  assert.ok(Math.abs(x - 0.25) < 1e-9 && Math.abs(Math.hypot(w, z) - 1) < 1e-9);
  assert.equal(run.pose(0, 0.75)?.[0], 0.5); // it is gone in the next row: no way leads there
  assert.equal(run.pose(0, 1), null);
  assert.deepEqual(run.power(0, 0.6), { left: 0.5, right: 0, source: 1 });
});

test("what holds at a time is told, and no sooner", () => {
  const run = new Run(read(packed()));
  assert.deepEqual([run.mode(0, 0.4), run.mode(0, 0.5)], ["", "autonomous"]);
  assert.deepEqual([run.finding(0, 0.4), run.finding(0, 0.5)], ["missing", "found"]);
  assert.deepEqual([run.score(0.4), run.score(0.5)], [0, 5]);
  assert.deepEqual(
    [0, 0.2, 0.7].map((time) => run.marks(time).length),
    [0, 1, 0],
  );
  assert.deepEqual([...run.chosen(0.2)], [[7, "R1"]]);
});

test("maps go forth and back", () => {
  const run = new Run(read(packed()));
  const at = (time: number): number[] => [...(run.map(time)?.cells ?? [])];
  assert.deepEqual(at(-1), []);
  assert.deepEqual(at(0), [0, 1, 0, 2]);
  assert.deepEqual(at(1), [0, 2, 0, 2]);
  assert.deepEqual(at(0), [0, 1, 0, 2]);
});

test("times as people read them", () => {
  assert.deepEqual([0, 59.96, 754.3, -0.1].map(clock), ["0:00.0", "1:00.0", "12:34.3", "-0:00.1"]);
});
