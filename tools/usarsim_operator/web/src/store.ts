// What the page knows: the last state, the newest scan, picture, map and path of each robot, and which
// robot is chosen. Panels listen; nothing here draws.

import { Beat } from "./beat";
import { defaults } from "./bindings";
import { Decoder } from "./decoder";
import { graphics } from "./gl";
import { KeyNames } from "./keynames";
import { Losses, Rounds } from "./measured";
import {
  type Grid,
  type LineRow,
  type Message,
  type Robot,
  type Scan,
  SPECTATOR,
  type State,
  type Vector,
  type Welcome,
} from "./protocol";
import { Ages, ageOf, isStale } from "./staleness";

export type Topic =
  | "link"
  | "welcome"
  | "state"
  | "select"
  | "scan"
  | "points"
  | "picture"
  | "map"
  | "path"
  | "poses"
  | "lines"
  | "event"
  | "asked"
  | "notice"
  | "theme"
  | "bindings"
  | "mark";

export interface Stamped {
  time: number;
}

export interface Slots {
  scan?: Scan & Stamped;
  points?: { points: Float32Array } & Stamped;
  path?: Float32Array;
  map?: Grid & Stamped;
  picture?: { image: ImageBitmap } & Stamped;
}

export interface Sample {
  time: number;
  speed: number;
  battery: number | null;
  signal: number | null;
  /** s since the robot was heard; null: never. */
  age: number | null;
}

const MOST_LINES = 500;
const MOST_SAMPLES = 600;

export const pageTime = (): number => performance.now() / 1000;

export class Store {
  readonly ages = new Ages();
  /** When what came is drawn: ten times a second where the processors draw. */
  readonly beat = new Beat(graphics().software ? 0.1 : 1 / 60, pageTime);
  private readonly decoder = new Decoder();
  /** What is printed on the keys; topic `bindings` tells of a change. */
  readonly keys = new KeyNames(defaults(), () => this.tell("bindings"));
  connected = false;
  refused = "";
  rtt = Number.NaN;
  readonly rounds = new Rounds();
  readonly losses = new Losses();
  welcome: Welcome | null = null;
  /** Page time of the last `welcome`, s. */
  welcomed = Number.NEGATIVE_INFINITY;
  state: State | null = null;
  selected = "";
  readonly slots = new Map<number, Slots>();
  /** How old the newest picture of each robot was when it was drawn, s, since the gateway was told. */
  readonly drawn = new Map<string, number>();
  readonly lines = new Map<string, LineRow[]>();
  readonly lost = new Map<string, number>();
  readonly history = new Map<string, Sample[]>();
  private readonly listeners = new Map<Topic, Set<(value: unknown) => void>>();

  on(topic: Topic, listener: (value: unknown) => void): void {
    const set = this.listeners.get(topic) ?? new Set();
    this.listeners.set(topic, set.add(listener));
  }

  tell(topic: Topic, value: unknown = null): void {
    for (const listener of this.listeners.get(topic) ?? []) listener(value);
  }

  get robots(): Robot[] {
    return this.state?.robots ?? [];
  }

  get robot(): Robot | null {
    return this.robots.find((robot) => robot.name === this.selected) ?? null;
  }

  /** Whether nothing that robots tell is newer than 1 s: the gateway is silent, or all of them are. */
  get frozen(): boolean {
    const now = pageTime();
    if (isStale(this.ages.silence(now))) return true;
    const heard = this.robots.map((robot) => this.ages.ofReport(robot.pose_age, now));
    return !this.ages.still && heard.length > 0 && heard.every(isStale);
  }

  /** A simulated time as the mission counts, from the last reset of the world on, s. */
  mission(time: number): number {
    return time - (this.state?.began ?? 0);
  }

  /** The next click into a picture or the map marks; topic `mark` tells of a change. */
  armed = false;
  /** A mark that is about to be set, and whose sight it is by; topic `mark`. */
  considered: { robot: string; place: Vector } | null = null;

  arm(on: boolean): void {
    this.armed = on;
    this.tell("mark");
  }

  consider(one: { robot: string; place: Vector } | null): void {
    this.considered = one;
    this.armed = false;
    this.tell("mark");
  }

  get mine(): boolean {
    const holder = this.robot?.holder;
    return !!holder && holder.page !== null && holder.page === this.welcome?.page;
  }

  slot(index: number): Slots {
    let slots = this.slots.get(index);
    if (!slots) {
      slots = {};
      this.slots.set(index, slots);
    }
    return slots;
  }

  select(name: string): void {
    if (name === this.selected || !this.robots.some((robot) => robot.name === name)) return;
    this.selected = name;
    this.tell("select");
  }

  heard(state: State): void {
    this.state = state;
    this.ages.heard(pageTime(), state.time, state.paused, state.speed);
    for (const robot of state.robots) this.remember(robot, state.time);
    this.forget();
    if (this.robot === null && state.robots[0]) this.select(state.robots[0].name);
    this.tell("state");
    this.beat.join();
  }

  /** Robots that have left: another one may get their index. */
  private forget(): void {
    const there = new Set(this.robots.map((robot) => robot.index));
    for (const [index, { picture }] of this.slots) {
      if (index === SPECTATOR || there.has(index)) continue;
      picture?.image.close();
      this.slots.delete(index);
    }
    for (const name of this.history.keys())
      if (!this.robots.some((robot) => robot.name === name)) this.history.delete(name);
  }

  private remember(robot: Robot, time: number): void {
    const samples = this.history.get(robot.name) ?? [];
    this.history.set(robot.name, samples);
    const last = samples.at(-1);
    if (last && time < last.time) samples.length = 0;
    else if (last && time - last.time < 0.19) return;
    const { speed, battery } = robot;
    const silent = ageOf(robot.link.age);
    const age = Number.isFinite(silent) ? silent : null;
    samples.push({ time, speed, battery, signal: robot.link.signal_dbm, age });
    if (samples.length > MOST_SAMPLES) samples.splice(0, samples.length - MOST_SAMPLES);
  }

  addLines(robot: string, rows: LineRow[], lost: number): void {
    const all = this.lines.get(robot) ?? [];
    this.lines.set(robot, all);
    all.push(...rows);
    if (all.length > MOST_LINES) all.splice(0, all.length - MOST_LINES);
    this.lost.set(robot, (this.lost.get(robot) ?? 0) + lost);
    this.tell("lines", robot);
  }

  async binary(message: Message): Promise<void> {
    const slots = this.slot(message.robot);
    const { time } = message;
    if (this.welcome?.numbered)
      this.losses.heard(`${message.kind} ${message.robot}`, message.sequence, pageTime());
    switch (message.kind) {
      case "picture": {
        const image = await this.decoder.decode(message.jpeg);
        if (slots.picture && slots.picture.time > time + 1e-9 && time > 1) return image.close();
        slots.picture?.image.close();
        slots.picture = { image, time };
        break;
      }
      case "scan":
        slots.scan = message;
        break;
      case "points":
        slots.points = message;
        break;
      case "map":
        slots.map = message;
        break;
      case "path":
        slots.path = message.points;
        break;
      case "poses":
        break;
    }
    this.tell(message.kind, message.kind === "poses" ? message : message.robot);
  }
}
