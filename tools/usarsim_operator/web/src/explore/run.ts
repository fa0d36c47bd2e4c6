// What the server tells of a run of `usarsim explore`, and where its pictures are.

export interface Overlay {
  name: string;
  default: boolean;
  help: string;
}

/** Said once. */
export interface Run {
  title: string;
  names: string[];
  overlays: Overlay[];
}

/** How far the run is; `shares` begins at the step that was asked for: team, base, each robot, percent. */
export interface Progress {
  ended: string | null;
  shares: number[][];
}

/** One robot, or the base, at a step. */
export interface Figure {
  name: string;
  role: string;
  state: string;
  works: boolean;
  own: number;
}

export async function ask<T>(path: string): Promise<T> {
  const answer = await fetch(path);
  if (!answer.ok) throw new Error(await answer.text());
  return (await answer.json()) as T;
}

/** Address of the picture of a step. */
export function picture(step: number, overlays: Iterable<string>, robot: string): string {
  return `picture?${new URLSearchParams({ step: String(step), overlays: [...overlays].join(","), robot })}`;
}

/** Steps a second by the notch of the slider; the last one is faster than pictures can be drawn. */
export const SPEEDS = [0, 1, 2, 4, 8, 15, 30, 60, 120, 250, 500];

/** Where a player is that began at a step: `elapsed` ms later, and no farther than the run. */
export function played(from: number, elapsed: number, speed: number, last: number): number {
  return Math.min(last, from + Math.floor((elapsed * speed) / 1000));
}

/** Points of a line of a chart of 100 x 100, at most some hundred of them, for an SVG. */
export function points(values: readonly number[], most = 400): string {
  const last = Math.max(values.length - 1, 1);
  const count = Math.min(values.length, most);
  const found: string[] = [];
  for (let i = 0; i < count; i++) {
    const step = count < 2 ? 0 : Math.round((i * (values.length - 1)) / (count - 1));
    found.push(`${((100 * step) / last).toFixed(2)},${(100 - (values[step] ?? 0)).toFixed(2)}`);
  }
  return found.join(" ");
}
