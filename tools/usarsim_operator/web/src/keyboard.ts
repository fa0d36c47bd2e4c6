// Keys held to a wish, and the two speed settings. Pure: events come in as codes.

/** What of a keyboard's event tells which key it was. */
export interface Pressed {
  code: string;
  key: string;
}

/**
 * The code of a key. Remote desktops and keyboards on the screen tell none: then it goes by what the key writes, as on a
 * keyboard with the layout of the United States.
 */
export function codeOf({ code, key }: Pressed): string {
  if (code !== "" && code !== "Unidentified") return code;
  if (/^[a-z]$/i.test(key)) return `Key${key.toUpperCase()}`;
  if (/^[0-9]$/.test(key)) return `Digit${key}`;
  return { " ": "Space", Spacebar: "Space", Esc: "Escape", Shift: "ShiftLeft" }[key] ?? key;
}

import type { Action, Bindings } from "./bindings";
import { SLOW, scaled, type Wish } from "./mixing";

const STEP = 0.1;

export class Keyboard {
  driving = 0.6;
  turning = 0.4;
  /** Codes of the keys that are down, and what they do: two keys may do the same. */
  private readonly held = new Map<string, Action>();
  private lastEscape = Number.NEGATIVE_INFINITY;
  /** Keys whose way down was seen; of others something else took it. */
  private readonly seen = new Set<string>();
  static readonly ESCAPE_TWICE_S = 0.6;

  constructor(public bindings: Bindings) {}

  action(code: string): Action | null {
    for (const [action, codes] of Object.entries(this.bindings.keys))
      if (codes.includes(code)) return action as Action;
    return null;
  }

  /** Whether any drive or speed key is down. */
  get holds(): boolean {
    return this.held.size > 0;
  }

  /**
   * Whether a key was pressed just now, by its way down or, where a list or a menu took that for itself, by its way up.
   * To be asked about each event of the key.
   */
  pressed(code: string, down: boolean, repeats: boolean): boolean {
    if (!down) return !this.seen.delete(code);
    this.seen.add(code);
    return !repeats;
  }

  /** Esc was pressed: whether for the second time within 0.6 s. */
  escape(now: number): boolean {
    const twice = now - this.lastEscape < Keyboard.ESCAPE_TWICE_S;
    this.lastEscape = twice ? Number.NEGATIVE_INFINITY : now;
    return twice;
  }

  /** A key goes down: returns the action that it starts (once, not again while it repeats). */
  down(code: string, repeats: boolean): Action | null {
    const action = this.action(code);
    if (action === null || repeats) return null;
    this.held.set(code, action);
    const part = (value: number): number =>
      Math.round(10 * Math.max(STEP, Math.min(1, value))) / 10;
    if (action === "faster") this.driving = part(this.driving + STEP);
    if (action === "slower") this.driving = part(this.driving - STEP);
    if (action === "turn_faster") this.turning = part(this.turning + STEP);
    if (action === "turn_slower") this.turning = part(this.turning - STEP);
    return action;
  }

  up(code: string): void {
    this.held.delete(code);
  }

  release(): void {
    this.held.clear();
  }

  wish(): Wish {
    const held = new Set(this.held.values());
    const axis = (plus: Action, minus: Action): number =>
      Number(held.has(plus)) - Number(held.has(minus));
    const wish: Wish = {
      forward: axis("forward", "back") * this.driving,
      turn: axis("right", "left") * this.turning,
      up: axis("up", "down") * this.driving,
      side: 0,
    };
    return held.has("slow") ? scaled(wish, SLOW) : wish;
  }
}
