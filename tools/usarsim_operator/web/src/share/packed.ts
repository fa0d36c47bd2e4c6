// The data of a shared run as `usarsim share` packs them: a table of contents and arrays of numbers, compressed.

import type { SceneFile } from "../scene";

export interface Raster {
  x: number;
  y: number;
  cell: number;
  rows: number;
  columns: number;
}

export interface Zone {
  name: string;
  colour: string;
  points: [number, number][];
}

export interface Victim {
  name: string;
  pos: number[];
  found: number | null;
  robot: string | null;
  credited: number | null;
  why: string | null;
}

export interface Robot {
  name: string;
  class: string;
  modes: [number, string][];
  told: [number, string][];
}

export type Scenery = Pick<SceneFile, "kinds" | "meshes" | "textures"> & {
  time: number;
  scene: NonNullable<SceneFile["scene"]>;
  things: { what: string; name: string; kind: string; first: number; lit: boolean }[];
  poses: number[];
};

export interface Contents {
  title: string;
  about: string;
  began: number;
  why: string;
  total: number;
  values: Record<string, number>;
  units: { place: number; turn: number; power: number; time: number };
  robots: Robot[];
  victims: Victim[];
  maps: (Raster & { steps: [number, number][] }) | null;
  floor: Raster | null;
  scenery: Scenery | null;
  zones: Zone[];
  /** Name, from, to, x, y, verdict. */
  marks: [string, number, number | null, number, number, string][];
  scores: [number, number][];
  /** Time, page, robot. */
  selected: [number, number, string][];
  /** Time, kind, robot, words. */
  events: [number, string, string, string][];
  notes: string[];
  arrays: [string, "i4" | "u1", number][];
}

export type Numbers = Int32Array | Uint8Array;

export interface Packed {
  contents: Contents;
  arrays: Map<string, Numbers>;
}

/** Undoes base64 and compression. */
export async function unpack(base64: string): Promise<Packed> {
  const bytes = Uint8Array.from(atob(base64.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return read(await new Response(stream).arrayBuffer());
}

/** Contents and arrays out of what was compressed. */
export function read(data: ArrayBuffer): Packed {
  const length = new DataView(data).getUint32(0, true);
  const text = new TextDecoder().decode(new Uint8Array(data, 4, length));
  const contents = JSON.parse(text) as Contents;
  const arrays = new Map<string, Numbers>();
  let at = 4 + length;
  for (const [name, kind, count] of contents.arrays) {
    if (kind === "u1") {
      arrays.set(name, new Uint8Array(data, at, count));
      at += 4 * Math.ceil(count / 4);
    } else {
      arrays.set(name, summed(new Int32Array(data.slice(at, at + 4 * count))));
      at += 4 * count;
    }
  }
  return { contents, arrays };
}

/** Each number is the difference to the one before it. */
function summed(values: Int32Array): Int32Array {
  for (let i = 1; i < values.length; i++) values[i] = (values[i] ?? 0) + (values[i - 1] ?? 0);
  return values;
}
