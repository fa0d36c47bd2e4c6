// Looks of robots: thirty in a row are unlike, and colours with one mark are told apart without full colour vision.

import assert from "node:assert/strict";
import { test } from "node:test";
import { robotLook } from "../src/looks";

type Rgb = [number, number, number];

/** Machado, Oliveira and Fernandes (2009), severity 1, for linear light. */
const VISIONS: Record<string, number[][]> = {
  full: [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ],
  protan: [
    [0.152286, 1.052583, -0.204868],
    [0.114503, 0.786281, 0.099216],
    [-0.003882, -0.048116, 1.051998],
  ],
  deutan: [
    [0.367322, 0.860646, -0.227968],
    [0.280085, 0.672501, 0.047413],
    [-0.01182, 0.04294, 0.968881],
  ],
  tritan: [
    [1.255528, -0.076749, -0.178779],
    [-0.078411, 0.930809, 0.147602],
    [0.004733, 0.691367, 0.3039],
  ],
};

function seen(colour: string, vision: number[][]): Rgb {
  const linear = [1, 3, 5].map((at) => {
    const value = Number.parseInt(colour.slice(at, at + 2), 16) / 255;
    return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
  });
  return vision.map((row) =>
    Math.max(
      0,
      row.reduce((sum, part, i) => sum + part * (linear[i] ?? 0), 0),
    ),
  ) as Rgb;
}

/** L*, a*, b* of linear light. */
function lab([r, g, b]: Rgb): Rgb {
  const f = (t: number): number => (t > 0.008856 ? Math.cbrt(t) : 7.787 * t + 16 / 116);
  const x = f((0.4124 * r + 0.3576 * g + 0.1805 * b) / 0.9505);
  const y = f(0.2126 * r + 0.7152 * g + 0.0722 * b);
  const z = f((0.0193 * r + 0.1192 * g + 0.9505 * b) / 1.089);
  return [116 * y - 16, 500 * (x - y), 200 * (y - z)];
}

test("thirty robots in a row have thirty looks", () => {
  for (const first of [0, 7, 226]) {
    const looks = new Set<string>();
    for (let n = 0; n < 30; n++) looks.add(JSON.stringify(robotLook(first + n)));
    assert.equal(looks.size, 30);
  }
});

test("of sixteen robots two with one mark differ by colour with every kind of colour vision", () => {
  for (const [name, vision] of Object.entries(VISIONS))
    for (let one = 0; one < 16; one++)
      for (let other = one + 1; other < 16; other++) {
        const [a, b] = [robotLook(one), robotLook(other)];
        if (a.shape !== b.shape) continue;
        const [p, q] = [lab(seen(a.colour, vision)), lab(seen(b.colour, vision))];
        const apart = Math.hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]);
        assert.ok(apart > 15, `${name}: robots ${one} and ${other} are ${apart.toFixed(1)} apart`);
      }
});
