// Decoding, ages, alarms, laser places and the pace of the 3D view (O-23, CON-08, CON-09, CON-18, CON-19).

import assert from "node:assert/strict";
import { test } from "node:test";
import { shown } from "../src/alarms";
import { Beat } from "../src/beat";
import { isSoftware } from "../src/gl";
import { flatPlace, project } from "../src/laser";
import { Losses, Rounds } from "../src/measured";
import { flippersOf } from "../src/more";
import { FramePace } from "../src/pace";
import { type Alarm, beamAngle, decode, rotate, scanPoints, toWorld } from "../src/protocol";
import { pieces } from "../src/shapes";
import { Ages, ageText, agoText, clockText, isStale } from "../src/staleness";

function message(kind: number, rest: (view: DataView) => void, size: number): ArrayBuffer {
  const view = new DataView(new ArrayBuffer(16 + size));
  view.setUint8(0, kind);
  view.setUint8(1, 3);
  view.setUint32(4, 77, true);
  view.setFloat64(8, 12.5, true);
  rest(new DataView(view.buffer, 16));
  return view.buffer;
}

function scan(ranges: number[], fov = Math.PI) {
  const buffer = message(
    2,
    (view) => {
      [fov, 8, 0.2, 0, -0.3, 0, 0, 0].forEach((value, i) => {
        view.setFloat32(4 * i, value, true);
      });
      view.setUint16(32, ranges.length, true);
      ranges.forEach((value, i) => {
        view.setFloat32(36 + 4 * i, value, true);
      });
    },
    36 + 4 * ranges.length,
  );
  const decoded = decode(buffer);
  assert.ok(decoded.kind === "scan");
  return decoded;
}

test("heads, scans, maps and paths are decoded", () => {
  const s = scan([1, 2, Number.NaN]);
  assert.equal(s.robot, 3);
  assert.equal(s.sequence, 77);
  assert.equal(s.time, 12.5);
  assert.equal(s.ranges[1], 2);
  const map = decode(
    message(
      5,
      (view) => {
        [0.5, -1, -2].forEach((value, i) => {
          view.setFloat32(4 * i, value, true);
        });
        view.setUint16(12, 2, true);
        view.setUint16(14, 3, true);
        [4, 1, 2, 2].forEach((value, i) => {
          view.setUint8(16 + i, value);
        });
      },
      20,
    ),
  );
  assert.ok(map.kind === "map");
  assert.deepEqual([...map.cells], [1, 1, 1, 1, 2, 2]);
  const path = decode(message(6, (view) => view.setUint32(0, 1, true), 12));
  assert.ok(path.kind === "path" && path.points.length === 2);
});

test("cut, overlong and unknown messages throw RangeError", () => {
  assert.throws(() => decode(new ArrayBuffer(5)), RangeError);
  assert.throws(() => decode(message(9, () => {}, 0)), RangeError);
  assert.throws(() => decode(message(3, (view) => view.setUint32(0, 9, true), 8)), RangeError);
  const long = message(
    5,
    (view) => {
      view.setUint16(12, 1, true);
      view.setUint16(14, 1, true);
      view.setUint8(16, 200);
    },
    18,
  );
  assert.throws(() => decode(long), RangeError);
});

test("O-23: the first beam is left, a wall at 2 m is at its radius and bearing, the longest is no hit", () => {
  const s = scan([2, 2, 8]);
  assert.equal(beamAngle(s, 0), -s.fov / 2);
  const [x, y] = flatPlace(beamAngle(s, 0), 2, { width: 200, bottom: 100, scale: 10 });
  assert.ok(Math.abs(x - 80) < 1e-4 && Math.abs(y - 100) < 1e-4);
  assert.deepEqual(flatPlace(0, 2, { width: 200, bottom: 100, scale: 10 }), [100, 80]);
  assert.deepEqual(
    scanPoints(s).map((end) => end.hit),
    [true, true, false],
  );
});

test("CON-09: points stand at the true height of the mount, turned by the pose", () => {
  const ahead = scanPoints(scan([2, 2, 2]))[1];
  assert.ok(
    ahead && Math.abs(ahead.point[0] - 2.2) < 1e-6 && Math.abs(ahead.point[2] + 0.3) < 1e-6,
  );
  const [x, y, z] = toWorld([1, 1, 0, 0, 0, Math.PI / 2], [2, 0, -0.3]);
  assert.ok(Math.hypot(x - 1, y - 3, z + 0.3) < 1e-9);
  const up = rotate([0, Math.PI / 2, 0], [1, 0, 0]);
  assert.ok(Math.hypot(up[0], up[1], up[2] + 1) < 1e-9, "pitch up is z up, which is negative");
});

test("O-24: in the 3D laser view left is left and nearer is lower in the picture", () => {
  const [left, right] = [project([2, -1, 0], 0, 300, 200), project([2, 1, 0], 0, 300, 200)];
  assert.ok(left && right && left[0] < right[0]);
  const [near, far] = [project([1, 0, 0], 0, 300, 200), project([5, 0, 0], 0, 300, 200)];
  assert.ok(near && far && near[1] > far[1]);
});

test("CON-19: what was heard grows stale by the page's clock alone, within 1.2 s", () => {
  const ages = new Ages();
  assert.ok(isStale(ages.ofReport(0, 5)), "never heard is stale");
  ages.heard(10, 40, false, 1);
  assert.ok(!isStale(ages.ofReport(0.1, 10.5)));
  assert.ok(isStale(ages.ofReport(0.1, 11.2)) && isStale(ages.ofStamp(39.9, 11.2)));
  ages.heard(20, 50, true, 1);
  assert.ok(isStale(ages.silence(21.2)) && isStale(ages.ofStamp(50, 21.2)), "paused and silent");
  for (let now = 20; now < 30; now += 0.1) ages.heard(now, 50, true, 1);
  assert.ok(!isStale(ages.ofStamp(49.9, 30)), "paused and heard: nothing ages");
});

test("CON-20: the clock follows simulated time at any pace, and stands while paused", () => {
  const ages = new Ages();
  ages.heard(0, 100, false, 4);
  assert.equal(ages.simulated(0.5), 102);
  ages.heard(1, 104, true, 4);
  assert.equal(ages.simulated(3), 104);
  assert.equal(clockText(3725), "1:02:05");
  assert.equal(clockText(65.9), "01:05");
  assert.equal(ageText(-0.04), "0.0 s", "never a sign");
  assert.equal(ageText(-15.7), "0.0 s");
  assert.equal(ageText(1e6), "–", "what never came has no age");
  assert.equal(agoText(-15.7), "0.0 s ago");
  assert.equal(agoText(200), "3 min ago");
  assert.equal(agoText(1e6), "never");
  assert.equal(ages.ofReport(-9, 1), 0);
  assert.equal(ageText(0.14), "0.1 s");
});

test("CON-18: at most five alarms, the gravest open ones first", () => {
  const alarms = Array.from(
    { length: 100 },
    (_, id): Alarm => ({
      id,
      robot: "R",
      kind: "stuck",
      severity: ((id % 3) + 1) as 1 | 2 | 3,
      text: "",
      since: id,
      acknowledged: id === 98,
      count: 1,
    }),
  );
  const rows = shown(alarms);
  assert.deepEqual(
    rows.map((alarm) => alarm.id),
    [95, 92, 89, 86, 83],
  );
});

test("CON-08: slow frames halve the picture, then come twice a second; time is left between them", () => {
  const pace = new FramePace();
  let now = 0;
  const draw = (took: number): void => {
    now += pace.wait(now);
    pace.drew(now, now + took);
    now += took;
    assert.ok(pace.wait(now) >= took - 1e-9);
  };
  for (let i = 0; i < 6; i++) draw(0.15);
  assert.equal(pace.quality, "half");
  for (let i = 0; i < 7; i++) draw(0.15);
  assert.equal(pace.quality, "demand");
  assert.ok(pace.wait(now) > 0.3);
  for (let i = 0; i < 700; i++) draw(0.01);
  assert.equal(pace.quality, "full");
});

test("O-37: short frames come no more often than they may", () => {
  const pace = new FramePace(1 / 12);
  pace.drew(0, 0.01);
  assert.ok(Math.abs(pace.wait(0.01) - (1 / 12 - 0.01)) < 1e-9);
  pace.drew(1, 1.06);
  assert.ok(Math.abs(pace.wait(1.06) - 0.06) < 1e-9, "long ones leave as much time as they took");
});

test("CON-08: frames that wait for others do not count while some are short; a view that came down comes back, later each time", () => {
  const pace = new FramePace();
  for (let i = 0; i < 60; i++) pace.drew(i, i + (i % 5 < 3 ? 0.3 : 0.06));
  assert.equal(pace.quality, "full");
  const frames = (took: number, until: string): number => {
    for (let n = 1; n < 2000; n++) {
      pace.drew(n, n + took);
      if (pace.quality === until) return n;
    }
    return 2000;
  };
  frames(0.2, "demand");
  const first = frames(0.06, "half");
  assert.ok(first < 60, `back after ${first}`);
  frames(0.2, "demand");
  assert.ok(frames(0.06, "half") > first);
  assert.equal(frames(0.06, "full"), 2000, "at full size a frame of four times that is too long");
});

test("O-38: what came is drawn together, at most so often; a change of the window takes it along", () => {
  let now = 0;
  let timers: { run: () => void; at: number }[] = [];
  const drawn: string[] = [];
  const beat = new Beat(
    0.1,
    () => now,
    (run) => run(),
    (run, ms) => {
      timers.push({ run, at: now + ms / 1000 });
      return timers.length;
    },
    () => {
      timers = [];
    },
  );
  const tick = (to: number): void => {
    now = to;
    for (const { run, at } of timers) if (at <= now + 1e-9) run();
  };
  const [a, b] = [() => drawn.push(`a ${now}`), () => drawn.push(`b ${now}`)];
  beat.ask(a);
  beat.ask(b);
  beat.ask(a);
  tick(0);
  assert.deepEqual(drawn, ["a 0", "b 0"]);
  beat.ask(a);
  tick(0.04);
  beat.join();
  assert.equal(drawn.length, 2, "too near the last one");
  tick(0.06);
  beat.join();
  assert.deepEqual(drawn.slice(2), ["a 0.06"]);
  beat.ask(b);
  tick(0.15);
  assert.equal(drawn.length, 3);
  tick(0.16);
  assert.deepEqual(drawn.slice(3), ["b 0.16"]);
});

test("CON-08: renderers without a graphics card are known by their names", () => {
  const soft = [
    "llvmpipe (LLVM 15.0.6, 256 bits)",
    "Google SwiftShader",
    "Microsoft Basic Render Driver",
  ];
  for (const name of [...soft, "ANGLE (Mesa, softpipe, OpenGL ES 3.1)"])
    assert.ok(isSoftware(name));
  for (const name of ["NVIDIA GeForce RTX 3060", "Mesa Intel(R) UHD 620", "Apple M2"])
    assert.ok(!isSoftware(name));
});

test("shapes become unit shapes; an endless plane gets an end", () => {
  assert.equal(pieces({ shape: "capsule", size: [0.1, 0.5], material: 0 }).length, 3);
  assert.equal(pieces({ shape: "plane", size: [0, 2], material: 0 })[0]?.[2].x, 60);
  assert.equal(pieces({ shape: "mesh", mesh: "m:1", material: 0 })[0]?.[0], "mesh:m:1");
});

test("flippers are the joints that a ground robot's status tells", () => {
  const joints = { FLFlipper: 0.5, FRFlipper: 0 };
  assert.deepEqual(flippersOf({ kind: "ground", joints }), [
    ["FLFlipper", 0.5],
    ["FRFlipper", 0],
  ]);
  assert.deepEqual(flippersOf({ kind: "legged", joints }), []);
  assert.deepEqual(flippersOf({ kind: "ground" }), []);
});

test("delay is half of the middle round trip, whatever a single pong does (CON-31)", () => {
  const rounds = new Rounds();
  assert.ok(Number.isNaN(rounds.delay));
  for (const round of [0.4, 0.42, 3, 0.38, 0.4]) rounds.add(round);
  assert.equal(rounds.delay, 0.2);
  for (let n = 0; n < 15; n++) rounds.add(0.1);
  assert.equal(rounds.delay, 0.05);
});

test("losses are gaps of the numbers of each stream, over the last minute (CON-31)", () => {
  const losses = new Losses();
  assert.ok(Number.isNaN(losses.share));
  // Every fifth of one stream, none of the other; both count from 1.
  for (let n = 1; n <= 100; n++) {
    if (n % 5 !== 1) losses.heard("picture 0", n, n / 10);
    losses.heard("scan 0", n, n / 10);
  }
  assert.equal(losses.sent, 200);
  assert.equal(losses.share, 0.1);
  for (let n = 101; n <= 900; n++) losses.heard("scan 0", n, n / 10);
  assert.equal(losses.share, 0);
  losses.heard("poses 0", 0xffffffff, 91);
  losses.heard("poses 0", 1, 91);
  assert.equal(losses.share, 1 / (losses.sent ?? 1));
});
