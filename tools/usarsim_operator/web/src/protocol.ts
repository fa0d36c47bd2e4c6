// What page and gateway say to each other (docs/console-protocol.md): types of the texts, and the
// decoder of the binary messages. Pure: no DOM, no socket, no clock.

export type Vector = [number, number, number];
export type Pose = [number, number, number, number, number, number];
export type Role = "operator" | "instructor" | "viewer";
export type Kind = "ground" | "car" | "aerial" | "underwater" | "legged" | "fixed";

export interface Holder {
  page: number | null;
  name: string;
}

export interface Bumper {
  ring: "front" | "rear";
  segment: number;
  pressed: boolean;
}

export interface SensorState {
  name: string;
  type: string;
  age: number;
  stale: boolean;
  rate_hz: number;
}

export interface Robot {
  name: string;
  index: number;
  class: string;
  kind: Kind;
  own: boolean;
  pose: Pose | null;
  pose_source: string;
  pose_age: number;
  speed: number;
  battery: number | null;
  light: boolean;
  enabled: boolean;
  /** It has answered what it is and carries; absent: yes. */
  learned?: boolean;
  /** Nobody can enable it before it has recovered. */
  failed?: boolean;
  /** The operator whose robot it is in a trial; null: everybody's. */
  seat?: number | null;
  mode: "operator" | "autonomous" | "controller" | "stopped";
  policy?: string | null;
  zone: string | null;
  link: { state: "good" | "weak" | "lost"; age: number; signal_dbm: number | null };
  holder: Holder | null;
  sensors: SensorState[];
  bumpers: Bumper[];
  camera: {
    on: boolean;
    age: number;
    rate_hz: number;
    dropped: number;
    /** Horizontal, rad; null where the camera tells none. */
    fov?: number | null;
    mount?: Vector;
    /** Where it looks, rad, right of ahead. */
    yaw?: number;
    /** `pan` to the right, `tilt` up, rad, as far as it can; null where nobody knows. */
    turned?: { pan?: number; tilt?: number } | null;
  } | null;
  laser: { on: boolean; age: number } | null;
  path: number;
  /** Positions of flippers and other joints by name, rad or m. */
  joints?: Record<string, number>;
}

export interface Alarm {
  id: number;
  robot: string;
  kind: string;
  severity: 1 | 2 | 3;
  text: string;
  since: number;
  acknowledged: boolean;
  count: number;
}

export interface Mark {
  id: number;
  robot: string;
  place: Vector;
  status: string;
  note: string;
  by: string;
  time: number;
}

export interface Zone {
  colour: "yellow" | "orange" | "red" | "blue";
  corners: [number, number][];
}

export interface State {
  type: "state";
  time: number;
  /** Simulated s from which the mission counts; absent: 0. */
  began?: number;
  gateway_clock: number;
  paused: boolean;
  speed: number;
  real_time_factor: number;
  estop: { by: string; time: number } | null;
  /** A trial waits for its operators, see `ready`. */
  waits?: boolean;
  mission: {
    name: string;
    remaining: number | null;
    found?: number;
    victims?: number;
    score?: number;
  } | null;
  robots: Robot[];
  alarms: Alarm[];
  alarms_hidden: number;
  marks: Mark[];
  zones?: Zone[];
  /** Names of the victims of the world, for those who see the truth. */
  victims?: string[];
}

export interface Welcome {
  type: "welcome";
  page: number;
  /** By which others know this page: what it said, else its role and a number. */
  name: string;
  role: Role;
  server: { address: string; level: string; software: string };
  features: { scene: boolean; takeover: boolean; pace: boolean; lines: boolean };
  watchdog_s: number;
  gateway_clock: number;
  /** s by which a viewer sees everything later. */
  delay_s?: number;
  /** Of an operator, from 1 on. */
  seat?: number;
  /** The only one that drives in a trial: `keyboard`, `gamepad`; or `any`. */
  device?: string;
  /** Whether `sequence` of binary messages counts those that were sent to this page. */
  numbered?: boolean;
}

export interface LineRow {
  time: number;
  direction: "in" | "out";
  text: string;
  reading: string | null;
  effect: string | null;
  fault: string | null;
}

export type Text =
  | State
  | Welcome
  | { type: "pong"; clock: number; gateway_clock: number }
  | { type: "event"; robot: string; kind: string; value: unknown; time: number }
  | { type: "asked"; robot: string; page: number; name: string }
  | { type: "lines"; robot: string; rows: LineRow[]; lost?: number }
  | { type: "answer"; id: number | null; ok: boolean; why?: string };

export interface Head {
  robot: number;
  flags: number;
  sequence: number;
  time: number;
}

export interface Scan {
  fov: number;
  maxRange: number;
  mount: Vector;
  turn: Vector;
  ranges: Float32Array;
}

export interface Grid {
  cell: number;
  x: number;
  y: number;
  columns: number;
  rows: number;
  cells: Uint8Array;
}

export type Message = Head &
  (
    | { kind: "picture"; jpeg: Uint8Array<ArrayBuffer> }
    | ({ kind: "scan" } & Scan)
    | { kind: "points"; points: Float32Array }
    | { kind: "poses"; generation: number; poses: Float32Array }
    | ({ kind: "map" } & Grid)
    | { kind: "path"; points: Float32Array }
  );

export const SPECTATOR = 255;
const HEAD = 16;

/** Reads one binary message; throws RangeError where it is cut short or of an unknown kind. */
export function decode(buffer: ArrayBuffer): Message {
  const view = new DataView(buffer);
  const head: Head = {
    robot: view.getUint8(1),
    flags: view.getUint16(2, true),
    sequence: view.getUint32(4, true),
    time: view.getFloat64(8, true),
  };
  switch (view.getUint8(0)) {
    case 1:
      return { kind: "picture", ...head, jpeg: new Uint8Array(buffer, HEAD) };
    case 2:
      return { kind: "scan", ...head, ...scan(view, buffer) };
    case 3:
      return { kind: "points", ...head, points: floats(buffer, 20, 3 * view.getUint32(16, true)) };
    case 4: {
      const poses = floats(buffer, 24, 7 * view.getUint32(20, true));
      return { kind: "poses", ...head, generation: view.getUint32(16, true), poses };
    }
    case 5:
      return { kind: "map", ...head, ...grid(view) };
    case 6:
      return { kind: "path", ...head, points: floats(buffer, 20, 2 * view.getUint32(16, true)) };
    default:
      throw new RangeError(`no binary message has kind ${view.getUint8(0)}`);
  }
}

function scan(view: DataView, buffer: ArrayBuffer): Scan {
  const at = (place: number): number => view.getFloat32(HEAD + 4 * place, true);
  return {
    fov: at(0),
    maxRange: at(1),
    mount: [at(2), at(3), at(4)],
    turn: [at(5), at(6), at(7)],
    ranges: floats(buffer, HEAD + 36, view.getUint16(HEAD + 32, true)),
  };
}

function grid(view: DataView): Grid {
  const columns = view.getUint16(HEAD + 12, true);
  const rows = view.getUint16(HEAD + 14, true);
  const cells = new Uint8Array(columns * rows);
  let filled = 0;
  for (let place = HEAD + 16; place + 1 < view.byteLength; place += 2) {
    const end = filled + view.getUint8(place);
    if (end > cells.length) throw new RangeError("the runs of a map are longer than the map");
    cells.fill(view.getUint8(place + 1), filled, end);
    filled = end;
  }
  if (filled !== cells.length) throw new RangeError("the runs of a map end before the map does");
  const at = (place: number): number => view.getFloat32(HEAD + 4 * place, true);
  return { cell: at(0), x: at(1), y: at(2), columns, rows, cells };
}

function floats(buffer: ArrayBuffer, start: number, count: number): Float32Array {
  return new Float32Array(buffer, start, count);
}

/** Turns a point of a robot's frame into the world's by its pose; z down in both. */
export function toWorld(pose: Pose, point: Vector): Vector {
  const [x, y, z, roll, pitch, yaw] = pose;
  const [a, b, c] = rotate([roll, pitch, yaw], point);
  return [x + a, y + b, z + c];
}

/** Rotates by roll about x, then pitch about y, then yaw about z. */
export function rotate([roll, pitch, yaw]: Vector, [x, y, z]: Vector): Vector {
  const [cr, sr, cp, sp, cy, sy] = [roll, pitch, yaw].flatMap((a) => [
    Math.cos(a),
    Math.sin(a),
  ]) as [number, number, number, number, number, number];
  const y1 = cr * y - sr * z;
  const z1 = sr * y + cr * z;
  const x2 = cp * x + sp * z1;
  return [cy * x2 - sy * y1, sy * x2 + cy * y1, -sp * x + cp * z1];
}

/** Where the beams of a scan end in the robot's frame: [x, y, z, hit] each; beams without a range are left out. */
export function scanPoints(s: Scan): { point: Vector; hit: boolean; range: number }[] {
  const ends: { point: Vector; hit: boolean; range: number }[] = [];
  s.ranges.forEach((range, beam) => {
    if (Number.isNaN(range)) return;
    const angle = beamAngle(s, beam);
    const [x, y, z] = rotate(s.turn, [range * Math.cos(angle), range * Math.sin(angle), 0]);
    const point: Vector = [s.mount[0] + x, s.mount[1] + y, s.mount[2] + z];
    ends.push({ point, hit: range < s.maxRange * 0.999, range });
  });
  return ends;
}

/** Angle of a beam, rad, clockwise positive (y is right): the first beam is the leftmost. */
export function beamAngle(s: Scan, beam: number): number {
  return s.ranges.length > 1 ? -s.fov / 2 + (s.fov * beam) / (s.ranges.length - 1) : 0;
}
