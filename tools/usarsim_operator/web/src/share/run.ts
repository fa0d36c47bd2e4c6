// A run at any of its moments. Times that come in are s since the trial began; places are MuJoCo's, m.

import type { Contents, Numbers, Packed } from "./packed";

export type Pose = [number, number, number, number, number, number, number];
export type Finding = "missing" | "found" | "credited";

export interface Power {
  left: number;
  right: number;
  /** Number of who says it, see SOURCES. */
  source: number;
}

export interface Standing {
  name: string;
  x: number;
  y: number;
  verdict: string;
}

export const SOURCES = [
  "",
  "operator",
  "timed move",
  "autonomy",
  "controller",
  "watchdog",
] as const;

const EMPTY = new Int32Array(0);
const PARTS = ["x", "y", "z", "qw", "qx", "qy", "qz"] as const;

/** Place of the last entry that is not later; -1: there is none. */
export function before(count: number, time: number, timeOf: (i: number) => number): number {
  let [low, high] = [0, count];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (timeOf(middle) <= time + 1e-6) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

export class Run {
  readonly contents: Contents;
  /** s since the trial began, of each row. */
  readonly times: Float64Array;
  readonly begin: number;
  readonly end: number;
  private readonly arrays: Map<string, Numbers>;
  private drawn = { step: -1, cells: new Uint8Array(0) };

  constructor({ contents, arrays }: Packed) {
    this.contents = contents;
    this.arrays = arrays;
    const { began, units } = contents;
    this.times = Float64Array.from(this.array("time"), (value) => value * units.time - began);
    this.begin = this.times[0] ?? 0;
    this.end = this.times[this.times.length - 1] ?? 0;
  }

  array(name: string): Numbers {
    return this.arrays.get(name) ?? EMPTY;
  }

  /** Row that holds at a time. */
  row(time: number): number {
    return Math.max(
      0,
      before(this.times.length, time, (i) => this.times[i] ?? 0),
    );
  }

  /** Row, the next one, and how far between them a time is. */
  private between(time: number): [number, number, number] {
    const row = this.row(time);
    const next = Math.min(row + 1, this.times.length - 1);
    const [from = 0, to = 0] = [this.times[row], this.times[next]];
    return [row, next, to > from ? Math.max(0, Math.min(1, (time - from) / (to - from))) : 0];
  }

  /** Where a robot is; null while it is not there. Between two rows it goes straight. */
  pose(robot: number, time: number): Pose | null {
    const [row, next, part] = this.between(time);
    const there = this.array(`${robot}.there`);
    if (!there[row]) return null;
    const { place, turn } = this.contents.units;
    const share = there[next] ? part : 0;
    const pose = PARTS.map((name, i) => {
      const values = this.array(`${robot}.${name}`);
      const [a = 0, b = 0] = [values[row], values[next]];
      return (a + (b - a) * share) * (i < 3 ? place : turn);
    }) as Pose;
    const length = Math.hypot(...pose.slice(3)) || 1;
    for (let i = 3; i < 7; i++) pose[i] = (pose[i] ?? 0) / length;
    return pose;
  }

  /** Where a victim is. */
  victim(number: number, time: number): [number, number, number] {
    const [row, next, part] = this.between(time);
    const [x = 0, y = 0, z = 0] = this.contents.victims[number]?.pos ?? [];
    const at = (name: string, still: number): number => {
      const values = this.array(`v${number}.${name}`);
      if (values.length === 0) return still;
      const [a = 0, b = 0] = [values[row], values[next]];
      return (a + (b - a) * part) * this.contents.units.place;
    };
    return [at("x", x), at("y", y), at("z", z)];
  }

  /** What has become of a victim. */
  finding(number: number, time: number): Finding {
    const victim = this.contents.victims[number];
    if (!victim || victim.found === null || !this.past(victim.found, time)) return "missing";
    return (victim.credited ?? 0) > 0 ? "credited" : "found";
  }

  power(robot: number, time: number): Power {
    const row = this.row(time);
    const of = (name: string): number => this.array(`${robot}.${name}`)[row] ?? 0;
    const { power } = this.contents.units;
    return { left: of("left") * power, right: of("right") * power, source: of("source") };
  }

  mode(robot: number, time: number): string {
    return this.held(this.contents.robots[robot]?.modes ?? [], time)?.[1] ?? "";
  }

  told(robot: number, time: number): string {
    return this.held(this.contents.robots[robot]?.told ?? [], time)?.[1] ?? "";
  }

  /** The robot that each page has chosen. */
  chosen(time: number): Map<number, string> {
    const found = new Map<number, string>();
    for (const [at, page, robot] of this.contents.selected)
      if (this.past(at, time)) found.set(page, robot);
    return found;
  }

  score(time: number): number {
    return this.held(this.contents.scores, time)?.[1] ?? 0;
  }

  marks(time: number): Standing[] {
    return this.contents.marks
      .filter(([, from, to]) => this.past(from, time) && (to === null || !this.past(to, time)))
      .map(([name, , , x, y, verdict]) => ({ name, x, y, verdict }));
  }

  /** Number of the newest map, and its cells, which are the same array each time; null before the first. */
  map(time: number): { step: number; cells: Uint8Array } | null {
    const { maps, began } = this.contents;
    if (!maps) return null;
    const wanted = before(maps.steps.length, time + began, (i) => maps.steps[i]?.[0] ?? 0);
    if (wanted < 0) return null;
    if (wanted < this.drawn.step || this.drawn.cells.length === 0)
      this.drawn = { step: -1, cells: new Uint8Array(maps.rows * maps.columns) };
    const [index, value] = [this.array("map.index"), this.array("map.value")];
    const { cells } = this.drawn;
    let at = 0;
    for (const [step, [, count]] of maps.steps.entries()) {
      if (step > this.drawn.step && step <= wanted)
        for (let i = at; i < at + count; i++) cells[index[i] ?? 0] = value[i] ?? 0;
      at += count;
    }
    this.drawn = { step: wanted, cells };
    return this.drawn;
  }

  private past(logged: number, time: number): boolean {
    return logged - this.contents.began <= time + 1e-6;
  }

  private held<T extends [number, unknown]>(entries: T[], time: number): T | undefined {
    return entries[before(entries.length, time + this.contents.began, (i) => entries[i]?.[0] ?? 0)];
  }
}

/** A time as people read it: minutes, seconds, tenths. */
export function clock(time: number): string {
  const tenths = Math.round(10 * Math.abs(time));
  const [minutes, rest] = [Math.floor(tenths / 600), tenths % 600];
  const seconds = `${String(Math.floor(rest / 10)).padStart(2, "0")}.${rest % 10}`;
  return `${time < 0 && tenths > 0 ? "-" : ""}${minutes}:${seconds}`;
}
