// What a link does, as it is met here: how long texts take, and how much of the frames never comes. Pure: times are s
// of the page.

/** s over which losses are counted; at 10 % of 50 frames a second that is 10 % within 0.5 %. */
const LOSS_OVER_S = 60;
const PARTS = 12;
const MOST_ROUNDS = 15;

/** The middle one of some numbers; NaN of none. */
export function median(values: readonly number[]): number {
  const sorted = [...values].sort((a, b) => a - b);
  const half = sorted.length >> 1;
  const upper = sorted[half] ?? Number.NaN;
  return sorted.length % 2 ? upper : (upper + (sorted[half - 1] ?? Number.NaN)) / 2;
}

/** Round trips of the last pings. */
export class Rounds {
  private readonly last: number[] = [];

  add(round: number): void {
    this.last.push(round);
    if (this.last.length > MOST_ROUNDS) this.last.shift();
  }

  /** One way of the two, s: half of the median round trip, so that a single late pong tells nothing. */
  get delay(): number {
    return median(this.last) / 2;
  }

  clear(): void {
    this.last.length = 0;
  }
}

/** Frames that came and frames that the gaps between their numbers tell of, in each stream. */
export class Losses {
  private readonly newest = new Map<string, number>();
  private readonly parts: { since: number; came: number; lost: number }[] = [];

  /** Notes a frame; `stream` is what is numbered by itself, from 1 on, `sequence` has 32 bits. */
  heard(stream: string, sequence: number, now: number): void {
    const before = this.newest.get(stream) ?? 0;
    this.newest.set(stream, sequence);
    const gap = (sequence - before) >>> 0;
    let part = this.parts.at(-1);
    if (!part || now - part.since >= LOSS_OVER_S / PARTS) {
      part = { since: now, came: 0, lost: 0 };
      this.parts.push(part);
      while (this.parts.length > PARTS) this.parts.shift();
    }
    part.came++;
    // A number that goes back is none of a link that keeps the order.
    if (gap > 0 && gap < 1 << 20) part.lost += gap - 1;
  }

  private sum(what: "came" | "lost"): number {
    return this.parts.reduce((sum, part) => sum + part[what], 0);
  }

  /** Frames that were sent in the last minute, as far as their numbers tell. */
  get sent(): number {
    return this.sum("came") + this.sum("lost");
  }

  /** Share of them that never came, 0 to 1; NaN before the first. */
  get share(): number {
    return this.sum("lost") / this.sent;
  }

  clear(): void {
    this.newest.clear();
    this.parts.length = 0;
  }
}
