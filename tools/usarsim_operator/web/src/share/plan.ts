// The run from above: what the team had mapped, zones, ways, robots, victims and marks at one moment. As in
// the report of a run x is to the right, y is up.

import { button, colour, h, mark, panel, Surface } from "../dom";
import { drawMark, robotColour } from "../looks";
import type { Raster, Zone } from "./packed";
import type { Run } from "./run";
import { findingColour } from "./stage";

const MARGIN_M = 0.8;
const LAYERS = { map: "Map", walls: "Walls", ways: "Ways", victims: "Victims" } as const;
type Layer = keyof typeof LAYERS;

export class Plan {
  readonly element: HTMLElement;
  private readonly surface: Surface;
  private readonly on = new Set<Layer>(["map", "walls", "ways", "victims"]);
  private readonly low: [number, number];
  private readonly high: [number, number];
  private readonly floor: HTMLCanvasElement | null = null;
  private map: { step: number; image: HTMLCanvasElement } | null = null;
  private time = 0;

  constructor(
    private readonly run: Run,
    private readonly chosen: () => number,
  ) {
    this.surface = new Surface("map of the run", () => this.draw());
    const tools = (Object.entries(LAYERS) as [Layer, string][]).map(([layer, text]) => {
      const b = button(text, `layer-${layer}`, () => {
        if (!this.on.delete(layer)) this.on.add(layer);
        mark(b, "aria-pressed", this.on.has(layer));
        this.draw();
      });
      b.setAttribute("aria-pressed", "true");
      return b;
    });
    const layers = h("div", { class: "choice", role: "group", "aria-label": "layers" }, ...tools);
    this.element = panel(
      "plan",
      "Map",
      [layers],
      h("div", { class: "stage" }, this.surface.canvas),
    );
    const { floor, zones, victims } = run.contents;
    const spots: [number, number][] = [
      ...zones.flatMap((zone) => zone.points),
      ...victims.map((one): [number, number] => [one.pos[0] ?? 0, one.pos[1] ?? 0]),
    ];
    if (floor) {
      spots.push([floor.x, floor.y]);
      spots.push([floor.x + floor.columns * floor.cell, floor.y + floor.rows * floor.cell]);
      this.floor = painted(floor, run.array("floor"), [null, null, colour("quiet")]);
    }
    run.contents.robots.forEach((_, number) => {
      for (const time of run.times) {
        const pose = run.pose(number, time);
        if (pose && !floor) spots.push([pose[0], pose[1]]);
      }
    });
    const edge = (axis: 0 | 1, most: boolean): number => {
      const values = spots.map((spot) => spot[axis]);
      return most ? Math.max(...values, 1) + MARGIN_M : Math.min(...values, -1) - MARGIN_M;
    };
    this.low = [edge(0, false), edge(1, false)];
    this.high = [edge(0, true), edge(1, true)];
  }

  show(time: number): void {
    this.time = time;
    this.draw();
  }

  /** Pictures of other colours are needed. */
  repaint(): void {
    this.map = null;
    this.draw();
  }

  private get scale(): number {
    const { width, height } = this.surface;
    return Math.min(width / (this.high[0] - this.low[0]), height / (this.high[1] - this.low[1]));
  }

  private screen(x: number, y: number): [number, number] {
    const { width, height } = this.surface;
    const [cx, cy] = [(this.low[0] + this.high[0]) / 2, (this.low[1] + this.high[1]) / 2];
    return [width / 2 + (x - cx) * this.scale, height / 2 - (y - cy) * this.scale];
  }

  private draw(): void {
    if (this.surface.width < 8) return;
    const g = this.surface.clear();
    const { contents } = this.run;
    const now = this.on.has("map") ? this.run.map(this.time) : null;
    if (now && contents.maps) {
      if (this.map?.step !== now.step) {
        const paints = [null, colour("free"), colour("wall")];
        this.map = { step: now.step, image: painted(contents.maps, now.cells, paints) };
      }
      this.raster(g, contents.maps, this.map.image, 1);
    }
    if (this.on.has("walls") && contents.floor && this.floor)
      this.raster(g, contents.floor, this.floor, 0.45);
    for (const zone of contents.zones) this.zone(g, zone);
    if (this.on.has("ways")) for (const number of contents.robots.keys()) this.way(g, number);
    if (this.on.has("victims")) {
      for (const number of contents.victims.keys()) this.victim(g, number);
      for (const one of this.run.marks(this.time)) this.cross(g, one.x, one.y, one.verdict);
    }
    for (const number of contents.robots.keys()) this.robot(g, number);
  }

  /** Columns of a raster run along x, rows along y, from the corner that is lowest here. */
  private raster(
    g: CanvasRenderingContext2D,
    { x, y, cell }: Raster,
    image: HTMLCanvasElement,
    alpha: number,
  ): void {
    const [left, bottom] = this.screen(x, y);
    const size = cell * this.scale;
    g.save();
    g.globalAlpha = alpha;
    g.imageSmoothingEnabled = false;
    g.transform(size, 0, 0, -size, left, bottom);
    g.drawImage(image, 0, 0);
    g.restore();
  }

  private zone(g: CanvasRenderingContext2D, zone: Zone): void {
    g.save();
    g.beginPath();
    for (const [x, y] of zone.points) g.lineTo(...this.screen(x, y));
    g.closePath();
    g.fillStyle = g.strokeStyle = colour(`zone-${zone.colour}`);
    g.globalAlpha = 0.12;
    g.fill();
    g.globalAlpha = 0.9;
    g.lineWidth = 1.5;
    g.stroke();
    g.fillStyle = colour("text");
    g.font = `11px ${getComputedStyle(document.body).fontFamily}`;
    const corner = zone.points.reduce((a, b) => (b[1] - b[0] > a[1] - a[0] ? b : a));
    const [column, row] = this.screen(...corner);
    if (zone.colour !== "blue") g.fillText(`${zone.name}, ${zone.colour}`, column + 4, row + 13);
    g.restore();
  }

  private way(g: CanvasRenderingContext2D, number: number): void {
    g.beginPath();
    const last = this.run.row(this.time);
    const every = Math.max(1, Math.floor(last / 2000));
    for (let row = 0; row <= last; row += every) {
      const pose = this.run.pose(number, this.run.times[row] ?? 0);
      if (pose) g.lineTo(...this.screen(pose[0], pose[1]));
    }
    g.strokeStyle = robotColour(number);
    g.lineWidth = 1.5;
    g.stroke();
  }

  private robot(g: CanvasRenderingContext2D, number: number): void {
    const pose = this.run.pose(number, this.time);
    if (!pose) return;
    const [x, y, , qw, qx, qy, qz] = pose;
    const yaw = Math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz));
    const [column, row] = this.screen(x, y);
    drawMark(g, number, {
      x: column,
      y: row,
      radius: number === this.chosen() ? 7 : 5.5,
      edge: colour(number === this.chosen() ? "text" : "panel"),
      width: 1.5,
      heading: Math.PI / 2 - yaw,
    });
    g.fillStyle = colour("text");
    g.font = `600 11px ${getComputedStyle(document.body).fontFamily}`;
    g.fillText(this.run.contents.robots[number]?.name ?? "", column + 9, row - 7);
  }

  /** A ring: empty while nobody has found the person, half for found, full for credited. */
  private victim(g: CanvasRenderingContext2D, number: number): void {
    const [x, y] = this.run.victim(number, this.time);
    const [column, row] = this.screen(x, y);
    const finding = this.run.finding(number, this.time);
    g.lineWidth = 2;
    g.strokeStyle = colour("text");
    g.fillStyle = findingColour(finding);
    g.beginPath();
    g.arc(column, row, 6, 0, 2 * Math.PI);
    g.stroke();
    if (finding === "missing") return;
    g.beginPath();
    g.arc(column, row, 5, 0, finding === "found" ? Math.PI : 2 * Math.PI);
    g.fill();
  }

  private cross(g: CanvasRenderingContext2D, x: number, y: number, verdict: string): void {
    const [column, row] = this.screen(x, y);
    g.strokeStyle = colour(verdict === "wrong" ? "danger" : "mark");
    g.lineWidth = 2;
    g.beginPath();
    for (const [dx, dy] of [
      [5, 5],
      [5, -5],
    ] as const) {
      g.moveTo(column - dx, row - dy);
      g.lineTo(column + dx, row + dy);
    }
    g.stroke();
  }
}

/** A raster as a picture, a pixel a cell; paints for unknown, free and wall. */
function painted(
  { columns, rows }: Raster,
  cells: ArrayLike<number>,
  paints: (string | null)[],
): HTMLCanvasElement {
  const image = h("canvas", { width: columns, height: rows });
  const g = image.getContext("2d");
  const data = g?.createImageData(columns, rows);
  if (!g || !data) return image;
  const tones = paints.map((paint) => (paint ? rgba(paint) : [0, 0, 0, 0]));
  for (let i = 0; i < columns * rows; i++)
    data.data.set(tones[cells[i] ?? 0] ?? [0, 0, 0, 0], 4 * i);
  g.putImageData(data, 0, 0);
  return image;
}

function rgba(hex: string): number[] {
  const part = (at: number): number => Number.parseInt(hex.slice(at, at + 2), 16);
  return [part(1), part(3), part(5), 255];
}
