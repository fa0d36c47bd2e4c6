// Mixing, arbitration, pace, keys and pad (O-29, O-31, O-32, O-35, O-36, CON-26, CON-27).

import assert from "node:assert/strict";
import { test } from "node:test";
import { BindingError, defaults, fromToml, toToml } from "../src/bindings";
import { driveText } from "../src/input";
import { codeOf, Keyboard } from "../src/keyboard";
import { KeyNames } from "../src/keynames";
import { Arbiter, allowed, NEUTRAL, Pacer, stick, type Wish, wheels } from "../src/mixing";
import { Pad } from "../src/pad";
import type { Pose, Scan, Vector } from "../src/protocol";
import { placeOfColumn } from "../src/sighting";

const wish = (forward: number, turn: number): Wish => ({ ...NEUTRAL, forward, turn });

test("O-32: 0.14 is in the dead zone, 0.16 is not, whatever the direction", () => {
  for (let angle = 0; angle < 6.3; angle += 0.3) {
    const [c, s] = [Math.cos(angle), Math.sin(angle)];
    assert.deepEqual(stick(0.14 * c, 0.14 * s), [0, 0]);
    assert.ok(Math.hypot(...stick(0.16 * c, 0.16 * s)) > 0);
  }
  assert.deepEqual(stick(1, 0), [1, 0]);
  assert.ok(Math.abs((stick(0.575, 0)[0] ?? 0) - 0.5 ** 1.5) < 1e-9);
  assert.deepEqual(stick(Number.NaN, 0), [0, 0]);
});

test("O-32: full diagonals keep wheels within one and the direction of the turn", () => {
  for (const forward of [-1, -0.4, 0, 0.7, 1])
    for (const turn of [-1, -0.2, 0.3, 1]) {
      const { left, right } = wheels(wish(forward, turn));
      assert.ok(Math.abs(left) <= 1 && Math.abs(right) <= 1);
      assert.equal(Math.sign(left - right), Math.sign(turn));
    }
  assert.deepEqual(wheels(wish(1, 1)), { left: 1, right: 0 });
});

test("O-29: keys and combinations give the documented wheel pairs, release gives zero", () => {
  const keyboard = new Keyboard(defaults());
  const pair = (...codes: string[]) => {
    keyboard.release();
    for (const code of codes) keyboard.down(code, false);
    const { left, right } = wheels(keyboard.wish());
    return [left, right].map((x) => Math.round(1000 * x) / 1000);
  };
  assert.deepEqual(pair("KeyW"), [0.6, 0.6]);
  assert.deepEqual(pair("ArrowDown"), [-0.6, -0.6]);
  assert.deepEqual(pair("KeyA"), [-0.4, 0.4]);
  assert.deepEqual(pair("KeyW", "KeyD"), [1, 0.2]);
  assert.deepEqual(pair("KeyW", "KeyS"), [0, 0]);
  assert.deepEqual(pair("KeyW", "ShiftLeft"), [0.18, 0.18]);
  assert.deepEqual(pair("KeyR", "KeyW"), [0.7, 0.7]);
  keyboard.up("KeyW");
  assert.deepEqual(keyboard.wish(), NEUTRAL);
});

test("CON-15: Escape twice stops, once or slowly does not, repeats do not count", () => {
  const keyboard = new Keyboard(defaults());
  const counts = (now: number, down = true, repeats = false): boolean =>
    keyboard.pressed("Escape", down, repeats) && keyboard.escape(now);
  assert.equal(counts(1), false);
  assert.equal(counts(1.2, true, true), false);
  assert.equal(counts(1.3, false), false);
  assert.equal(counts(1.4), true);
  assert.equal(counts(1.5, false), false);
  assert.equal(counts(3), false);
  assert.equal(counts(3.1, false), false);
  assert.equal(counts(4), false);
  assert.equal(counts(4.1, false), false);
  // A list that was open took the first one's way down.
  assert.equal(counts(6, false), false);
  assert.equal(counts(6.3), true);
});

test("keys without a code go by what they write", () => {
  const of = (key: string, code = ""): string => codeOf({ key, code });
  assert.equal(of(" "), "Space");
  assert.equal(of("Escape"), "Escape");
  assert.equal(of("w"), "KeyW");
  assert.equal(of("W", "Unidentified"), "KeyW");
  assert.equal(of("7"), "Digit7");
  assert.equal(of("ArrowUp"), "ArrowUp");
  assert.equal(of("z", "KeyW"), "KeyW");
});

test("keys are called by what is printed on them, codes stay in files", () => {
  let changes = 0;
  const names = new KeyNames(defaults(), () => changes++);
  assert.equal(names.of("forward"), "W");
  names.learn("KeyW", "z");
  names.learn("KeyW", "Z");
  names.learn("KeyM", ",");
  names.learn("KeyE", "Dead");
  names.learn("Space", " ");
  names.learn("Digit1", "&");
  assert.equal(changes, 2);
  assert.deepEqual(
    [names.of("forward"), names.of("mark"), names.of("estop"), names.name("KeyE")],
    ["Z", ",", "Space", "E"],
  );
  assert.equal(names.exact("KeyW"), "Z (KeyW)");
  assert.equal(names.exact("KeyR"), "KeyR");
  assert.equal(names.name("Digit1"), "1");
});

test("the pad that drives is one whose layout is known, of several the one touched last", () => {
  const button = (pressed: boolean) => ({ pressed });
  const made = (index: number, mapping: string, id: string, ...on: number[]) => ({
    index,
    mapping,
    id,
    axes: [0, -1, 0, 0],
    buttons: Array.from({ length: 17 }, (_, i) => button(on.includes(i))),
  });
  const pad = new Pad(defaults());
  const mouse = made(0, "", "mouse", 0, 1);
  const first = made(1, "standard", "first");
  const second = made(2, "standard", "second");
  assert.equal(pad.choose([mouse]), null);
  assert.equal(pad.choose([mouse, first, second]), first);
  assert.equal(pad.choose([mouse, first, made(2, "standard", "second", 5)])?.id, "second");
  assert.equal(pad.choose([mouse, first, second]), second);
  assert.equal(pad.choose([mouse, first]), first);
  // Presses of one pad are not those of another.
  assert.deepEqual(pad.presses(made(1, "standard", "first", 10, 11)), ["estop_left"]);
  assert.deepEqual(pad.presses(made(2, "standard", "second", 10, 11)), ["estop_left"]);
  assert.deepEqual(pad.presses(made(1, "standard", "first", 10, 11)), []);
});

test("O-31: a stick without the dead man's button moves nothing, letting it go stops at once", () => {
  const pad = new Pad(defaults());
  const buttons = Array.from({ length: 17 }, () => ({ pressed: false }));
  const snapshot = { axes: [0.5, -1, 0, 0], buttons };
  assert.deepEqual(pad.wish(snapshot), NEUTRAL);
  buttons[5] = { pressed: true };
  assert.ok(pad.wish(snapshot).forward > 0.8 && pad.wish(snapshot).turn > 0);
  buttons[5] = { pressed: false };
  assert.deepEqual(pad.wish(snapshot), NEUTRAL);
});

test("O-30: presses come once, and an emergency stop needs both sticks", () => {
  const pad = new Pad(defaults());
  const press = (...on: number[]) =>
    pad.presses({
      axes: [],
      buttons: Array.from({ length: 17 }, (_, i) => ({ pressed: on.includes(i) })),
    });
  assert.deepEqual(press(0), ["robot_1"]);
  assert.deepEqual(press(0), []);
  assert.deepEqual(press(8, 9).sort(), ["connect", "laser"]);
  assert.deepEqual(press(10), []);
  assert.deepEqual(press(10, 11), ["estop_left"]);
});

test("O-35: the first device holds control until neutral for 250 ms", () => {
  const arbiter = new Arbiter();
  const [keys, pad] = [wish(1, 0), wish(0, 1)];
  const choose = (keyboard: Wish, other: Wish, now: number) =>
    arbiter.choose({ keyboard, pad: other, touch: NEUTRAL }, now);
  assert.equal(choose(NEUTRAL, pad, 0), pad);
  assert.equal(choose(keys, pad, 0.1), pad);
  assert.equal(choose(keys, NEUTRAL, 0.2), NEUTRAL);
  assert.equal(choose(keys, NEUTRAL, 0.44), NEUTRAL);
  assert.equal(choose(keys, NEUTRAL, 0.46), keys);
  assert.equal(arbiter.device, "keyboard");
  // Looked at late, it still is zero once before the next one drives.
  assert.equal(choose(NEUTRAL, pad, 0.9), NEUTRAL);
  assert.equal(choose(NEUTRAL, pad, 1.2), pad);
});

test("O-36: 20 commands a second while driving, one on zero, none while neutral", () => {
  const pacer = new Pacer();
  let sent = 0;
  for (let tick = 0; tick < 600; tick++) sent += Number(pacer.due(wish(1, 0), tick / 60));
  assert.ok(sent >= 199 && sent <= 202, `${sent} in 10 s`);
  assert.equal(pacer.due(NEUTRAL, 10.01), true);
  for (let tick = 0; tick < 600; tick++) assert.equal(pacer.due(NEUTRAL, 10.02 + tick / 60), false);
  assert.equal(pacer.due(wish(1, 0), 25), true);
});

test("drive texts by the kind of robot", () => {
  const text = (kind: "car" | "aerial" | "ground") =>
    driveText({ name: "R", kind }, wish(0.5, 0.25), "pad");
  assert.deepEqual(text("ground"), {
    type: "drive",
    robot: "R",
    device: "pad",
    left: 0.75,
    right: 0.25,
  });
  assert.deepEqual(text("car"), {
    type: "steer",
    robot: "R",
    device: "pad",
    speed: 0.5,
    steer: 0.25,
  });
  assert.equal(text("aerial").type, "fly");
});

test("CON-27: bindings survive TOML, conflicts are refused with both names", () => {
  const bindings = defaults();
  bindings.keys.forward = ["KeyI"];
  bindings.buttons.dead_man = 7;
  assert.deepEqual(fromToml(toToml(bindings)), bindings);
  const refused = (text: string, ...words: string[]) =>
    assert.throws(
      () => fromToml(text),
      (error: unknown) => {
        assert.ok(error instanceof BindingError);
        for (const word of words)
          assert.ok(error.message.includes(word), `${word} in ${error.message}`);
        return true;
      },
    );
  refused('[keys]\nmark = ["KeyW"]', "drive forward", "mark a victim", "KeyW");
  refused("[buttons]\nslow = 5", "drive while held", "slow while held");
  refused('[keys]\nmark = ["Digit1"]', "fixed");
  refused('[keys]\njump = ["KeyJ"]', "line 2", "jump");
  refused("[keys]\nmark = KeyM", "line 2");
  refused("[wheels]", "line 1");
});

test("marks: the sight through a picture meets the scan, seen from the camera", () => {
  const ranges = new Float32Array(181).fill(2);
  const pose: Pose = [1, 1, 0, 0, 0, Math.PI / 2];
  const seen = { on: true, age: 0, rate_hz: 5, dropped: 0, fov: Math.PI / 2 };
  const scan: Scan = { fov: Math.PI, maxRange: 8, mount: [0, 0, -0.3], turn: [0, 0, 0], ranges };
  const at = (column: number, mount: Vector = [0, 0, 0]) =>
    placeOfColumn({ pose, camera: { ...seen, mount } }, column, scan)?.map(
      (x) => Math.round(100 * x) / 100,
    );
  assert.deepEqual(at(0), [1, 3, -0.3]);
  assert.deepEqual(at(0.5), [-0.41, 2.41, -0.3]); // right of a robot that looks along y is minus x
  assert.deepEqual(at(0.5, [1, 0, 0]), [0.19, 2.83, -0.3]); // 45 degrees at the camera are 24 at the laser
  const aside = { ...seen, mount: [0, 0, 0] as Vector, yaw: Math.PI / 2 };
  const right = placeOfColumn({ pose, camera: aside }, 0, scan);
  assert.ok(right && Math.hypot(right[0] + 1, right[1] - 1) < 1e-6);
  ranges.fill(8);
  assert.equal(at(0), undefined);
  assert.equal(placeOfColumn({ pose: null, camera: null }, 0, scan), null);
});

test("only the device of a trial's condition drives; who wants to by another one is told", () => {
  const go = wish(0.6, 0);
  const keyed = { keyboard: go, pad: NEUTRAL, touch: NEUTRAL };
  assert.deepEqual(allowed(keyed, undefined), { wishes: keyed, refused: false });
  assert.deepEqual(allowed(keyed, "any"), { wishes: keyed, refused: false });
  assert.deepEqual(allowed(keyed, "keyboard"), { wishes: keyed, refused: false });
  const { wishes, refused } = allowed({ ...keyed, pad: go, touch: go }, "gamepad");
  assert.deepEqual(wishes, { keyboard: NEUTRAL, pad: go, touch: NEUTRAL });
  assert.ok(refused);
  assert.ok(!allowed({ keyboard: NEUTRAL, pad: go, touch: NEUTRAL }, "gamepad").refused);
});
