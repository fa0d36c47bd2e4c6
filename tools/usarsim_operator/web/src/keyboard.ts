// Keys held to a wish, and the two speed settings. Pure: events come in as codes.

import type { Action, Bindings } from "./bindings";
import { SLOW, scaled, type Wish } from "./mixing";

const STEP = 0.1;

export class Keyboard {
  driving = 0.6;
  turning = 0.4;
  /** Codes of the keys that are down, and what they do: two keys may do the same. */
  private readonly held = new Map<string, Action>();
  private lastEscape = Number.NEGATIVE_INFINITY;
  static readonly ESCAPE_TWICE_S = 0.6;

  constructor(public bindings: Bindings) {}

  action(code: string): Action | null {
    for (const [action, codes] of Object.entries(this.bindings.keys))
      if (codes.includes(code)) return action as Action;
    return null;
  }

  /** A key goes down: returns the action that it starts (once, not again while it repeats). */
  down(code: string, now: number, repeats: boolean): Action | null {
    if (code === "Escape" && !repeats) {
      const twice = now - this.lastEscape < Keyboard.ESCAPE_TWICE_S;
      this.lastEscape = twice ? Number.NEGATIVE_INFINITY : now;
      return twice ? "estop" : null;
    }
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
