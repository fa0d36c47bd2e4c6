import assert from "node:assert/strict";
import { test } from "node:test";
import { layout } from "../src/grid";

test("O-20: 1 to 16 tiles fill their cells, save at most two, and the chosen one is larger", () => {
  for (const [width, height] of [
    [746, 320],
    [1170, 470],
  ] as const)
    for (let n = 1; n <= 16; n++) {
      const { rows, columns, spare } = layout(n, width, height);
      assert.equal(rows * rows + (n - 1) + spare, rows * columns, `${n} tiles`);
      assert.ok(spare <= 2, `${n} tiles leave ${spare} cells`);
      assert.ok(n < 3 || rows > 1, `the chosen one of ${n} is not larger`);
      const cell = Math.min(width / columns, (height / rows) * (4 / 3));
      assert.ok(cell * columns > 0.75 * width, `${n} tiles leave the sides empty`);
    }
});
