// A gamepad to a wish and to presses. Pure: a snapshot of the pad comes in. Pads of the standard layout share
// the bindings; each other one has a map of its own, by what it calls itself.

import type { Axis, Bindings, PadAction } from "./bindings";
import { NEUTRAL, SLOW, scaled, stick, type Wish } from "./mixing";

export interface Snapshot {
  id?: string;
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
  private before = new Set<PadAction>();

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

  /** The pad is gone: what was pressed is not any more. */
  lost(): void {
    this.before = new Set();
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
    const fresh = [...now].filter((action) => !this.before.has(action));
    this.before = now;
    return fresh;
  }
}
