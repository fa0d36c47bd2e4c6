// How old what is shown is. Ages come from the gateway; the page adds what has passed since on its own
// clock, so that frozen input grows stale by itself. Pure: page time comes in as a number (s).

export const STALE_S = 1;
/** What a gateway tells of something that never came. */
const NEVER_S = 1e6;
/** Between two looks at ages: what is older than that shows so within 1.2 s. */
export const LOOK_MS = 190;

export class Ages {
  private arrived = Number.NEGATIVE_INFINITY;
  private time = 0;
  private rate = 1;
  /** Whether the world stands still, so that nothing in it can grow old. */
  still = false;

  /** Notes the arrival of a state text at page time `now`, of simulated time `time`. */
  heard(now: number, time: number, paused: boolean, speed: number): void {
    this.arrived = now;
    this.time = time;
    this.still = paused;
    this.rate = paused ? 0 : Math.max(0, speed);
  }

  /** s of page time since the gateway was heard. */
  silence(now: number): number {
    return now - this.arrived;
  }

  /** Simulated time now, s: that of the last state, gone on at its pace for as long as the gateway is heard. */
  simulated(now: number): number {
    return this.time + this.rate * Math.min(Math.max(0, this.silence(now)), 5);
  }

  /** Age now of something that was `reported` s old in the last state text. */
  ofReport(reported: number, now: number): number {
    return ageOf(reported) + Math.max(0, this.silence(now));
  }

  /** Age now of something stamped with a simulated time, at least the silence of the gateway beyond 0.5 s. */
  ofStamp(stamp: number, now: number): number {
    const silence = this.silence(now);
    return Math.max(0, this.simulated(now) - stamp, silence > 0.5 ? silence : 0);
  }

  /**
   * Age now of something with a stamp that was `reported` s old in the last state text. A server that hangs
   * stops the time of the stamps, too: then the report tells it.
   */
  ofDatum(stamp: number, reported: number, now: number): number {
    const age = this.ofStamp(stamp, now);
    return this.still ? age : Math.max(age, this.ofReport(reported, now));
  }
}

export function isStale(age: number): boolean {
  return !(age <= STALE_S);
}

/** What no age is below or beyond: s, 0 where a clock is behind; infinity for never. */
export function ageOf(age: number): number {
  return age >= NEVER_S || Number.isNaN(age) ? Number.POSITIVE_INFINITY : Math.max(0, age);
}

/** How long ago, for people: `0.1 s ago`, `never`. */
export function agoText(age: number): string {
  return Number.isFinite(ageOf(age)) ? `${ageText(age)} ago` : "never";
}

/** An age for people: `0.1 s`, `12 s`, `3 min`; `–` of what never was. */
export function ageText(told: number): string {
  const age = ageOf(told);
  if (!Number.isFinite(age)) return "–";
  if (age < 9.95) return `${age.toFixed(1)} s`;
  return age < 120 ? `${Math.round(age)} s` : `${Math.round(age / 60)} min`;
}

/** Seconds as `12:34` (or `1:02:03`). */
export function clockText(seconds: number): string {
  const whole = Math.max(0, Math.floor(seconds));
  const pad = (n: number): string => String(n).padStart(2, "0");
  const [h, m, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  return h > 0 ? `${h}:${pad(m)}:${pad(s)}` : `${pad(m)}:${pad(s)}`;
}
