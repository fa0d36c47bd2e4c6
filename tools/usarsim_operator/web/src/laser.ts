// The chosen robot's laser: from above (robot at the bottom), as strips whose height falls with distance
// (classic), and as points at their true x, y, z. All by 2D canvas, so it needs no WebGL.

import { button, choice, colour, h, mark, panel, rem, Surface, say } from "./dom";
import type { Link } from "./link";
import { beamAngle, type Scan, scanPoints, type Vector } from "./protocol";
import { ageText, isStale, LOOK_MS } from "./staleness";
import { pageTime, type Store } from "./store";
import { newsText, waitText } from "./waiting";

type View = "flat" | "strips" | "points";

/** Colour of a distance, from near (warm) to far (blue), readable with every colour vision. */
export function distanceColour(part: number): string {
  const stops = [
    [240, 180, 60],
    [200, 90, 90],
    [120, 70, 160],
    [50, 90, 180],
  ];
  const place = Math.max(0, Math.min(0.999, part)) * (stops.length - 1);
  const [a, b] = [stops[Math.floor(place)] ?? [0, 0, 0], stops[Math.floor(place) + 1] ?? [0, 0, 0]];
  const mix = a.map((value, i) => Math.round(value + ((b[i] ?? 0) - value) * (place % 1)));
  return `rgb(${mix.join(" ")})`;
}

/** Where a beam's end is in the flat plot: the robot at (width / 2, bottom), ahead is up, left is left. */
export function flatPlace(
  angle: number,
  range: number,
  s: { width: number; bottom: number; scale: number },
): [number, number] {
  return [
    s.width / 2 + s.scale * range * Math.sin(angle),
    s.bottom - s.scale * range * Math.cos(angle),
  ];
}

export function laser(store: Store, link: Link, first: View = "flat"): HTMLElement {
  let view = first;
  let turn = 0.5;
  const surface = new Surface("laser scan of the chosen robot", () => draw());
  const age = h("span", { class: "quiet number", "data-age": true });
  const toggle = button(
    "Off",
    "laser",
    () => {
      const { robot } = store;
      if (robot?.laser) link.request({ type: "laser", robot: robot.name, on: !robot.laser.on });
    },
    "pad: Select",
  );
  const views = choice(
    "laser view",
    { flat: "2D", strips: "Classic", points: "3D" },
    view,
    (value) => {
      view = value;
      draw();
    },
  );
  const note = h("p", { class: "empty" });
  const stage = h("div", { class: "stage" }, surface.canvas, note);
  const element = panel("laser", "Laser", [age, views, toggle], stage);
  surface.canvas.addEventListener("pointermove", (event) => {
    if (event.buttons === 0) return;
    turn += event.movementX / 150;
    draw();
  });

  const draw = (): void => {
    const now = pageTime();
    const { robot } = store;
    const slots = robot ? store.slot(robot.index) : {};
    const { scan } = slots;
    const cloud = view === "points" ? slots.points : undefined;
    const newest = Math.max(
      scan?.time ?? Number.NEGATIVE_INFINITY,
      cloud?.time ?? Number.NEGATIVE_INFINITY,
    );
    const old = store.ages.ofDatum(newest, robot?.laser?.age ?? 0, now);
    const on = robot?.laser?.on ?? false;
    mark(element, "data-stale", isStale(old));
    mark(element, "data-view", view);
    mark(element, "data-laser", robot?.laser ? (on ? "on" : "off") : "none");
    toggle.disabled = !robot?.laser;
    say(toggle, on ? "Off" : "On");
    say(age, on && Number.isFinite(old) ? ageText(old) : "");
    say(
      note,
      !robot
        ? newsText(store, now)
        : !robot.laser
          ? robot.learned === false || store.state?.paused
            ? waitText(store, `scan of ${robot.name}`, now)
            : "no laser has reported"
          : !on
            ? "laser off"
            : scan || cloud
              ? isStale(old)
                ? "frozen"
                : ""
              : waitText(store, `scan of ${robot.name}`, now),
    );
    const g = surface.clear();
    if (!robot?.laser || !on || surface.width < 40 || surface.height < 40) return;
    if (view === "flat" && scan) {
      const { scale, bottom } = flat(g, surface, scan);
      mark(element, "data-scale", scale.toFixed(4));
      mark(element, "data-origin", `${(surface.width / 2).toFixed(2)} ${bottom.toFixed(2)}`);
    }
    if (view === "strips" && scan) strips(g, surface, scan);
    if (view === "points") points(g, surface, scan, cloud?.points, turn);
  };
  for (const topic of ["scan", "points"] as const)
    store.on(topic, (index) => {
      if (store.robot?.index === index) store.beat.ask(draw);
    });
  store.on("select", draw);
  store.on("theme", draw);
  setInterval(draw, LOOK_MS);
  return element;
}

/** Draws the plot; px per m, and px from the top to where the robot is. */
function flat(
  g: CanvasRenderingContext2D,
  { width, height }: Surface,
  scan: Scan,
): { scale: number; bottom: number } {
  const behind = scan.fov > Math.PI ? -Math.cos(scan.fov / 2) : 0;
  const scale = Math.min(
    (height - 26) / scan.maxRange / (1 + behind),
    (width - 16) / 2 / scan.maxRange,
  );
  const bottom = height - 14 - scale * scan.maxRange * behind;
  const place = (angle: number, range: number): [number, number] =>
    flatPlace(angle, range, { width, bottom, scale });
  g.lineWidth = 1;
  g.strokeStyle = colour("line");
  g.fillStyle = colour("quiet");
  g.font = `${rem(11)}px ${colour("font")}`;
  const step = scan.maxRange > 12 ? 5 : scan.maxRange > 4 ? 2 : 1;
  for (let ring = step; ring <= scan.maxRange + 1e-6; ring += step) {
    g.beginPath();
    g.arc(
      width / 2,
      bottom,
      scale * ring,
      -Math.PI / 2 - scan.fov / 2,
      -Math.PI / 2 + scan.fov / 2,
    );
    g.stroke();
    g.fillText(`${ring} m`, width / 2 + 3, bottom - scale * ring - 2);
  }
  g.beginPath();
  for (const side of [-1, 1]) {
    g.moveTo(width / 2, bottom);
    g.lineTo(...place((side * scan.fov) / 2, scan.maxRange));
  }
  g.stroke();
  g.beginPath();
  g.moveTo(width / 2, bottom);
  scan.ranges.forEach((range, beam) => {
    if (!Number.isNaN(range))
      g.lineTo(...place(beamAngle(scan, beam), Math.min(range, scan.maxRange)));
  });
  g.closePath();
  g.fillStyle = colour("seen");
  g.fill();
  scan.ranges.forEach((range, beam) => {
    if (Number.isNaN(range)) return;
    const hit = range < scan.maxRange * 0.999;
    const [x, y] = place(beamAngle(scan, beam), Math.min(range, scan.maxRange));
    g.fillStyle = colour(hit ? "accent" : "quiet");
    if (hit) g.fillRect(x - 1.25, y - 1.25, 2.5, 2.5);
    else if (beam % 4 === 0) g.fillRect(x - 0.5, y - 0.5, 1, 1);
  });
  g.fillStyle = colour("text");
  g.beginPath();
  g.moveTo(width / 2, bottom - 7);
  g.lineTo(width / 2 - 5, bottom + 5);
  g.lineTo(width / 2 + 5, bottom + 5);
  g.fill();
  return { scale, bottom };
}

function strips(g: CanvasRenderingContext2D, { width, height }: Surface, scan: Scan): void {
  const wide = width / scan.ranges.length;
  scan.ranges.forEach((range, beam) => {
    if (Number.isNaN(range) || range >= scan.maxRange * 0.999) return;
    const tall = Math.min(height - 8, (0.5 * height) / Math.max(range, 0.3) + 4);
    g.fillStyle = distanceColour(range / scan.maxRange);
    g.fillRect(beam * wide, (height - tall) / 2, wide + 0.5, tall);
  });
  g.strokeStyle = colour("line");
  g.beginPath();
  g.moveTo(width / 2, 0);
  g.lineTo(width / 2, height);
  g.stroke();
}

/** Projects a point of the robot's frame (z down) onto the picture of an eye behind and above it. */
export function project(
  [x, y, z]: Vector,
  turn: number,
  width: number,
  height: number,
): [number, number, number] | null {
  const [c, s] = [Math.cos(turn), Math.sin(turn)];
  const [ahead, right] = [c * x + s * y, c * y - s * x];
  const tilt = 0.5;
  const [ex, ez] = [ahead + 3.2, z + 2.4];
  const depth = ex * Math.cos(tilt) + ez * Math.sin(tilt);
  if (depth < 0.1) return null;
  const down = ez * Math.cos(tilt) - ex * Math.sin(tilt);
  const scale = Math.min(width, height * 1.4) / depth;
  return [width / 2 + right * scale, height / 2 + down * scale, depth];
}

function points(
  g: CanvasRenderingContext2D,
  { width, height }: Surface,
  scan: Scan | undefined,
  cloud: Float32Array | undefined,
  turn: number,
): void {
  const line = (a: Vector, b: Vector): void => {
    const [p, q] = [project(a, turn, width, height), project(b, turn, width, height)];
    if (!p || !q) return;
    g.moveTo(p[0], p[1]);
    g.lineTo(q[0], q[1]);
  };
  g.strokeStyle = colour("line");
  g.beginPath();
  for (let i = -6; i <= 6; i++) {
    line([i, -6, 0.1], [i, 6, 0.1]);
    line([-6, i, 0.1], [6, i, 0.1]);
  }
  g.stroke();
  const dot = (point: Vector, size: number): void => {
    const at = project(point, turn, width, height);
    if (!at) return;
    g.fillStyle = distanceColour(Math.hypot(...point) / 8);
    const wide = Math.max(1.2, (size * 14) / at[2]);
    g.fillRect(at[0] - wide / 2, at[1] - wide / 2, wide, wide);
  };
  for (let i = 0; cloud && i + 2 < cloud.length; i += 3)
    dot([cloud[i] ?? 0, cloud[i + 1] ?? 0, cloud[i + 2] ?? 0], 1);
  for (const end of scan ? scanPoints(scan) : []) if (end.hit) dot(end.point, 1.6);
  g.strokeStyle = colour("text");
  g.lineWidth = 1.5;
  g.beginPath();
  for (const [a, b] of [
    [
      [0.3, 0, 0],
      [-0.2, -0.2, 0],
    ],
    [
      [-0.2, -0.2, 0],
      [-0.2, 0.2, 0],
    ],
    [
      [-0.2, 0.2, 0],
      [0.3, 0, 0],
    ],
  ] as [Vector, Vector][])
    line(a, b);
  g.stroke();
}
