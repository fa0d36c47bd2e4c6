// What a page still needs before a trial begins (O-33).

import assert from "node:assert/strict";
import { test } from "node:test";
import { missingFor } from "../src/ready";

const robot = { name: "R1", index: 0, camera: { on: true } };

function needs(device: string, known: object | null, pad: boolean, picture: boolean) {
  const slot = () => (picture ? { picture: {} } : {});
  return missingFor({ welcome: { device }, robot: known, slot } as never, pad);
}

test("a gamepad trial needs a pad that answers, every trial the first picture", () => {
  assert.equal(needs("gamepad", robot, false, true), "pad");
  assert.equal(needs("gamepad", robot, true, false), "picture");
  assert.equal(needs("gamepad", robot, true, true), null);
  assert.equal(needs("keyboard", robot, false, true), null);
  assert.equal(needs("any", null, false, true), "robot");
  assert.equal(needs("any", { ...robot, learned: false }, false, true), "robot");
  assert.equal(needs("any", { ...robot, camera: null }, false, false), null, "nothing to wait for");
});
