// A gamepad to a wish and to presses. Pure: a snapshot of the pad comes in. Pads of the standard layout share
// the bindings; each other one has a map of its own, by what it calls itself.

import type { Axis, Bindings, PadAction } from "./bindings";
import { NEUTRAL, SLOW, scaled, stick, type Wish } from "./mixing";

export interface Snapshot {
  id?: string;
  index?: number;
  mapping?: string;
  axes: readonly number[];
  buttons: readonly { pressed: boolean }[];
}

/** Which control of a pad does what; an axis in `reversed` counts the other way round. */
export interface PadMap extends Pick<Bindings, "buttons" | "axes"> {
  reversed?: Axis[];
}

export type PadMaps = Record<string, PadMap>;

export class Pad {
  /** What was pressed when each pad was read last, by the pad's place in the browser's list. */
  private readonly before = new Map<number, Set<PadAction>>();
  private chosen: number | null = null;

  constructor(
    public bindings: Bindings,
    readonly maps: PadMaps = {},
  ) {}

  /** Whether it is known what the pad's controls are. */
  knows(pad: Snapshot): boolean {
    return pad.mapping === "standard" || Object.hasOwn(this.maps, pad.id ?? "");
  }

  map(pad: Snapshot): PadMap {
    if (pad.mapping === "standard") return this.bindings;
    return this.maps[pad.id ?? ""] ?? this.bindings;
  }

  /**
   * The pad that drives: its layout is known; of several it is the one that was touched last. Receivers of mice, flight
   * gear and the like are in the browser's list, too, often before it.
   */
  choose<T extends Snapshot>(pads: readonly T[]): T | null {
    for (const index of this.before.keys())
      if (!pads.some((pad) => (pad.index ?? 0) === index)) this.before.delete(index);
    const known = pads.filter((pad) => this.knows(pad));
    const current = known.find((pad) => (pad.index ?? 0) === this.chosen);
    const found =
      current && this.touched(current)
        ? current
        : (known.find((pad) => this.touched(pad)) ?? current ?? known[0] ?? null);
    this.chosen = found ? (found.index ?? 0) : null;
    return found;
  }

  /** Whether any of its buttons is pressed; of a pad whose layout is known, any that does something. */
  touched(pad: Snapshot): boolean {
    if (!this.knows(pad)) return pad.buttons.some((button) => button.pressed);
    return Object.values(this.map(pad).buttons).some((number) => pad.buttons[number]?.pressed);
  }

  /** What the sticks want; nothing without the dead man's button. */
  wish(pad: Snapshot): Wish {
    const map = this.map(pad);
    const pressed = (action: PadAction): boolean =>
      pad.buttons[map.buttons[action]]?.pressed ?? false;
    if (!pressed("dead_man")) return NEUTRAL;
    const axis = (name: Axis): number =>
      (pad.axes[map.axes[name]] ?? 0) * (map.reversed?.includes(name) ? -1 : 1);
    const [turn, forward] = stick(axis("turn"), axis("forward"));
    const [side, up] = stick(axis("side"), axis("up"));
    const wish = { forward: 0 - forward, turn, up: 0 - up, side };
    return pressed("slow") ? scaled(wish, SLOW) : wish;
  }

  /** The actions whose buttons went down since the last call; an emergency stop needs both of its buttons. */
  presses(pad: Snapshot): PadAction[] {
    const { buttons } = this.map(pad);
    const actions = Object.keys(buttons) as PadAction[];
    const now = new Set(actions.filter((action) => pad.buttons[buttons[action]]?.pressed));
    if (!(now.has("estop_left") && now.has("estop_right"))) now.delete("estop_left");
    now.delete("estop_right");
    const before = this.before.get(pad.index ?? 0);
    this.before.set(pad.index ?? 0, now);
    return [...now].filter((action) => !before?.has(action));
  }
}
