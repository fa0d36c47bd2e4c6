// The page of explorations: where a player is, and the lines of its chart.

import assert from "node:assert/strict";
import { test } from "node:test";
import { picture, played, points } from "../src/explore/run";

test("a player goes by its speed, and never farther than the run", () => {
  assert.equal(played(10, 1000, 15, 100), 25);
  assert.equal(played(10, 66, 15, 100), 10);
  assert.equal(played(10, 67, 15, 100), 11);
  assert.equal(played(90, 5000, 15, 100), 100);
  assert.equal(played(10, 5000, 0, 100), 10);
});

test("addresses of pictures name step, overlays and robot", () => {
  assert.equal(
    picture(7, ["free", "path"], "R 1"),
    "picture?step=7&overlays=free%2Cpath&robot=R+1",
  );
});

test("lines go from the first to the last step with few points", () => {
  assert.equal(points([0, 50, 100]), "0.00,100.00 50.00,50.00 100.00,0.00");
  assert.equal(points([20]), "0.00,80.00");
  const many = points(Array.from({ length: 3001 }, (_, i) => i / 30)).split(" ");
  assert.equal(many.length, 400);
  assert.equal(many.at(-1), "100.00,0.00");
});
