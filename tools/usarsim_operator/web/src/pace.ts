// How often and how large the 3D view is drawn. A frame is drawn only when something changed, never sooner than
// as long after the last one as that one took; where frames exceed 100 ms the view goes to half size, and then
// to two frames a second. It comes back when frames have become short, later each time that was too early.
// Pure: times come in, s.

export type Quality = "full" | "half" | "demand";

export class FramePace {
  quality: Quality = "full";
  private readonly recent: number[] = [];
  private next = 0;
  private calm = 0;
  private patience = 8;
  static readonly SLOW_S = 0.1;
  static readonly JUDGED = 6;

  /** `least`: s from one frame to the next, however short they are. */
  constructor(private readonly least = 1 / 30) {}

  /** s until the next frame may be drawn. */
  wait(now: number): number {
    return Math.max(0, this.next - now);
  }

  /** Notes a frame begun at `start` that was on the screen at `end`; true when the quality changed. */
  drew(start: number, end: number): boolean {
    const took = end - start;
    const changed = this.judge(took);
    const least = this.quality === "demand" ? 0.5 : this.least;
    this.next = end + Math.max(least - took, took, 0.004);
    return changed;
  }

  private judge(took: number): boolean {
    this.recent.push(took);
    if (this.recent.length > FramePace.JUDGED) this.recent.shift();
    if (this.recent.length < FramePace.JUDGED) return false;
    // What a frame costs is what one takes that does not wait for others' work: nearly the shortest of them.
    const usual = [...this.recent].sort((a, b) => a - b)[1] ?? 0;
    const before = this.quality;
    const [fits, frames] = before === "demand" ? [0.7, 1] : [0.3, 8];
    if (usual > FramePace.SLOW_S) {
      this.calm = 0;
      this.quality = before === "full" ? "half" : "demand";
      if (before !== "demand") this.patience = Math.min(2 * this.patience, 240);
    } else if (usual > fits * FramePace.SLOW_S) this.calm = 0;
    else if (before !== "full" && ++this.calm > frames * this.patience) {
      this.calm = 0;
      this.quality = before === "demand" ? "half" : "full";
    }
    if (this.quality !== before) this.recent.length = 0;
    return this.quality !== before;
  }
}
