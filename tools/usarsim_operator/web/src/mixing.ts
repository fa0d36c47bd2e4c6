// From sticks and keys to wheel powers: dead zone, curve, mixing, arbitration of devices, and the
// pace of the commands. Pure: time comes in as a number (s).

export type Device = "keyboard" | "pad" | "touch";

/** The device that drives alone where a trial says so, by the word of its condition. */
const ONLY: Record<string, Device> = { keyboard: "keyboard", gamepad: "pad" };

/** Wishes of the devices that may drive; `refused` is one that may not and wants to. */
export function allowed(
  wishes: Record<Device, Wish>,
  only: string | undefined,
): { wishes: Record<Device, Wish>; refused: boolean } {
  const one = ONLY[only ?? ""];
  if (one === undefined) return { wishes, refused: false };
  const others = (Object.keys(wishes) as Device[]).filter((device) => device !== one);
  const found = { ...wishes };
  for (const device of others) found[device] = NEUTRAL;
  return { wishes: found, refused: others.some((device) => !isNeutral(wishes[device])) };
}

/** What the operator wants: forward and turn (right is positive), and for aircraft up and sideways (right); -1 to 1. */
export interface Wish {
  forward: number;
  turn: number;
  up: number;
  side: number;
}

export const NEUTRAL: Wish = { forward: 0, turn: 0, up: 0, side: 0 };
export const DEAD_ZONE = 0.15;
export const EXPONENT = 1.5;
export const SLOW = 0.3;

export const clamp = (x: number): number => Math.max(-1, Math.min(1, x));

export function isNeutral(wish: Wish): boolean {
  return wish.forward === 0 && wish.turn === 0 && wish.up === 0 && wish.side === 0;
}

/** A stick after the radial dead zone (rescaled behind it) and the curve; its direction stays. */
export function stick(x: number, y: number): [number, number] {
  const length = Math.hypot(x, y);
  if (!(length > DEAD_ZONE)) return [0, 0];
  const part = Math.min(1, (length - DEAD_ZONE) / (1 - DEAD_ZONE)) ** EXPONENT;
  return [(x / length) * part, (y / length) * part];
}

/** Wheel powers of a wish; divided together where one is above 1, so that the direction stays. */
export function wheels(wish: Wish): { left: number; right: number } {
  const left = wish.forward + wish.turn;
  const right = wish.forward - wish.turn;
  const most = Math.max(1, Math.abs(left), Math.abs(right));
  return { left: clamp(left / most), right: clamp(right / most) };
}

export function scaled(wish: Wish, factor: number): Wish {
  return {
    forward: wish.forward * factor,
    turn: wish.turn * factor,
    up: wish.up * factor,
    side: wish.side * factor,
  };
}

/** Lets one device drive: the first that is not neutral holds control until it was neutral for 250 ms. */
export class Arbiter {
  device: Device | null = null;
  private neutralSince: number | null = null;
  static readonly RELEASE_S = 0.25;

  choose(wishes: Record<Device, Wish>, now: number): Wish {
    if (this.device !== null) {
      const wish = wishes[this.device];
      // From when it was seen to be neutral: a late look at it still says zero before another one drives.
      this.neutralSince = isNeutral(wish) ? (this.neutralSince ?? now) : null;
      if (this.neutralSince === null || now - this.neutralSince < Arbiter.RELEASE_S) return wish;
      this.device = null;
    }
    for (const device of Object.keys(wishes) as Device[]) {
      if (isNeutral(wishes[device])) continue;
      this.device = device;
      this.neutralSince = null;
      return wishes[device];
    }
    return NEUTRAL;
  }
}

/** Says when to send: at once when a drive begins or ends, 20 times a second between, never while neutral. */
export class Pacer {
  private driving = false;
  private next = 0;
  static readonly PERIOD_S = 0.05;

  due(wish: Wish, now: number): boolean {
    if (isNeutral(wish)) {
      const ends = this.driving;
      this.driving = false;
      return ends;
    }
    if (this.driving && now < this.next - 1e-3) return false;
    const late = !this.driving || now > this.next + Pacer.PERIOD_S;
    this.next = (late ? now : this.next) + Pacer.PERIOD_S;
    this.driving = true;
    return true;
  }
}
