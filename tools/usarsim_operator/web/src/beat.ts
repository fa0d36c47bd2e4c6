// One beat for what is drawn anew because something came: pictures, map, laser. The browser puts its window together
// once for all of it, which costs software GL more than the pictures themselves. Pure: time and frames come in.

export class Beat {
  private readonly due = new Set<() => void>();
  private last = Number.NEGATIVE_INFINITY;
  private timer = 0;
  private asked = false;

  /** `least`: s between two beats. */
  constructor(
    private readonly least: number,
    private readonly now: () => number,
    private readonly frame: (run: () => void) => void = (run) => requestAnimationFrame(run),
    private readonly later: (run: () => void, ms: number) => number = (run, ms) =>
      window.setTimeout(run, ms),
    private readonly cancel: (timer: number) => void = (timer) => clearTimeout(timer),
  ) {}

  /** Has something done at the next beat, once, however often it is asked for. */
  ask(draw: () => void): void {
    this.due.add(draw);
    if (this.asked || this.timer) return;
    this.timer = this.later(
      () => this.begin(),
      Math.max(0, 1000 * (this.last + this.least - this.now())),
    );
  }

  /** The window changes anyway: what waits is drawn with it, unless the last beat is too near. */
  join(): void {
    if (this.timer && this.now() - this.last > this.least / 2) this.begin();
  }

  private begin(): void {
    this.cancel(this.timer);
    this.timer = 0;
    this.asked = true;
    this.frame(() => {
      this.asked = false;
      this.last = this.now();
      const due = [...this.due];
      this.due.clear();
      for (const draw of due) draw();
    });
  }
}
