// Points over time, and below a lane for each robot: who drove it when, who looked at it, what happened to it.
// A click goes there.

import { colour, panel, Surface } from "../dom";
import { drawMark, robotColour } from "../looks";
import { clock, type Run } from "./run";

/** Pixels for names at the left, and at the right. */
export const GUTTER = { left: 76, right: 16 } as const;
const CURVE = { top: 8, height: 74 } as const;
const LANE = { most: 15, least: 7 } as const;
const AXIS = 18;

const TICKS: Record<string, { paint: string; shape: "diamond" | "bar" }> = {
  found: { paint: "good", shape: "diamond" },
  wrong: { paint: "danger", shape: "diamond" },
  collision: { paint: "danger", shape: "bar" },
  lost: { paint: "danger", shape: "diamond" },
};

export class Lanes {
  readonly element: HTMLElement;
  private readonly surface: Surface;
  private time = 0;
  private still: HTMLCanvasElement | null = null;

  constructor(
    private readonly run: Run,
    seek: (time: number) => void,
  ) {
    this.surface = new Surface("points over time, and what robots did", () => this.repaint());
    const { canvas } = this.surface;
    canvas.style.height = `${this.height}px`;
    this.element = panel("lanes", "Points and robots", [], canvas);
    const go = (event: PointerEvent): void => {
      if (event.buttons === 0) return;
      const wide = this.surface.width - GUTTER.left - GUTTER.right;
      const share = (event.offsetX - GUTTER.left) / wide;
      seek(run.begin + Math.max(0, Math.min(1, share)) * (run.end - run.begin));
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      go(event);
    });
    canvas.addEventListener("pointermove", go);
  }

  private get lane(): number {
    const count = Math.max(1, this.run.contents.robots.length);
    return Math.max(LANE.least, Math.min(LANE.most, 120 / count));
  }

  private get height(): number {
    return CURVE.top + CURVE.height + 6 + this.lane * this.run.contents.robots.length + AXIS;
  }

  show(time: number): void {
    this.time = time;
    this.draw();
  }

  /** Draws what does not change with the time anew. */
  repaint(): void {
    this.still = null;
    this.draw();
  }

  private column(time: number): number {
    const { run } = this;
    const span = Math.max(run.end - run.begin, 1e-3);
    const wide = this.surface.width - GUTTER.left - GUTTER.right;
    return GUTTER.left + ((time - run.begin) / span) * wide;
  }

  private draw(): void {
    const { surface } = this;
    if (surface.width < 8) return;
    if (!this.still) {
      this.paint(surface.clear());
      this.still = document.createElement("canvas");
      this.still.width = surface.canvas.width;
      this.still.height = surface.canvas.height;
      this.still.getContext("2d")?.drawImage(surface.canvas, 0, 0);
    }
    const g = surface.clear();
    g.drawImage(this.still, 0, 0, surface.width, surface.height);
    const column = this.column(this.time);
    g.fillStyle = colour("text");
    g.fillRect(column - 0.75, 0, 1.5, this.height - AXIS + 3);
  }

  private paint(g: CanvasRenderingContext2D): void {
    const { contents } = this.run;
    g.font = `11px ${getComputedStyle(document.body).fontFamily}`;
    g.textBaseline = "middle";
    this.curve(g);
    const top = CURVE.top + CURVE.height + 6;
    for (const number of contents.robots.keys()) this.robot(g, number, top + this.lane * number);
    this.axis(g, top + this.lane * contents.robots.length);
  }

  private curve(g: CanvasRenderingContext2D): void {
    const { scores, began } = this.run.contents;
    const totals = scores.map(([, total]) => total);
    const [low, high] = [Math.min(0, ...totals), Math.max(1, ...totals)];
    const row = (total: number): number =>
      CURVE.top + 6 + ((high - total) / (high - low)) * (CURVE.height - 12);
    g.fillStyle = colour("quiet");
    g.textAlign = "right";
    g.fillText(String(Math.round(high)), GUTTER.left - 8, row(high));
    g.fillText("points", GUTTER.left - 8, (row(high) + row(low)) / 2);
    g.fillText(String(Math.round(low)), GUTTER.left - 8, row(low));
    g.strokeStyle = colour("line");
    g.lineWidth = 1;
    g.beginPath();
    g.moveTo(GUTTER.left, row(0));
    g.lineTo(this.surface.width - GUTTER.right, row(0));
    g.stroke();
    g.strokeStyle = colour("accent");
    g.lineWidth = 2;
    g.beginPath();
    for (const [time, total] of scores) g.lineTo(this.column(time - began), row(total));
    g.stroke();
  }

  /** Full: an operator drives; half: by itself; a thin line below: an operator has chosen it. */
  private robot(g: CanvasRenderingContext2D, number: number, top: number): void {
    const { run, lane } = this;
    const { name, told } = run.contents.robots[number] ?? { name: "", told: [] };
    // What flies or steers has no power of wheels in its commands.
    const speaks = told.length > 0;
    g.fillStyle = colour("text");
    g.textAlign = "right";
    g.fillText(name.slice(0, 9), GUTTER.left - 20, top + lane / 2);
    const radius = Math.min(5, lane / 2 - 1);
    const mark = { x: GUTTER.left - 10, y: top + lane / 2, radius, edge: colour("panel") };
    drawMark(g, number, mark);
    g.fillStyle = colour("raised");
    g.fillRect(GUTTER.left, top + 1, this.surface.width - GUTTER.left - GUTTER.right, lane - 2);
    g.fillStyle = robotColour(number);
    const step = (run.end - run.begin) / Math.max(1, this.surface.width - GUTTER.left);
    for (let time = run.begin; time < run.end; time += step) {
      const { left, right, source } = run.power(number, time);
      const mode = run.mode(number, time);
      const wheels = (source === 1 || source === 2) && (left !== 0 || right !== 0);
      const driven = wheels || (speaks && mode === "teleoperated");
      const column = this.column(time);
      if (driven) g.fillRect(column, top + 1, 1.6, lane - 3);
      else if (mode === "autonomous") {
        g.globalAlpha = 0.55;
        g.fillRect(column, top + lane / 2 - 1, 1.6, lane / 2 - 2);
        g.globalAlpha = 1;
      }
      if ([...run.chosen(time).values()].includes(name)) {
        g.fillStyle = colour("text");
        g.fillRect(column, top + lane - 2, 1.6, 1);
        g.fillStyle = robotColour(number);
      }
    }
    for (const [time, kind, robot] of run.contents.events) {
      const tick = robot === name ? TICKS[kind] : undefined;
      if (tick) this.tick(g, this.column(time - run.contents.began), top + lane / 2, tick);
    }
  }

  private tick(
    g: CanvasRenderingContext2D,
    column: number,
    row: number,
    { paint, shape }: { paint: string; shape: "diamond" | "bar" },
  ): void {
    const size = Math.min(5, this.lane / 2);
    g.save();
    g.fillStyle = colour(paint);
    g.strokeStyle = colour("panel");
    g.beginPath();
    if (shape === "bar") g.rect(column - 1, row - size, 2, 2 * size);
    else {
      g.moveTo(column, row - size);
      g.lineTo(column + size, row);
      g.lineTo(column, row + size);
      g.lineTo(column - size, row);
      g.closePath();
    }
    g.stroke();
    g.fill();
    g.restore();
  }

  private axis(g: CanvasRenderingContext2D, top: number): void {
    const { run } = this;
    const most = Math.max(1, (this.surface.width - GUTTER.left - GUTTER.right) / 90);
    const steps = [1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600];
    const step = steps.find((one) => (run.end - run.begin) / one <= most) ?? 7200;
    g.fillStyle = colour("quiet");
    g.textAlign = "center";
    for (let time = Math.ceil(run.begin / step) * step; time <= run.end; time += step) {
      g.fillRect(this.column(time), top, 1, 4);
      g.fillText(clock(time).replace(".0", ""), this.column(time), top + 11);
    }
  }
}
