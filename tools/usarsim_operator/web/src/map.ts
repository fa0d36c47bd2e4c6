// The map: what scans have shown, zones, paths, robots, marks; each layer can be switched off. North (x) is
// up, right (y) is right. Drag moves, the wheel zooms, a double click marks a victim.

import { button, colour, h, mark, panel, rem, Surface } from "./dom";
import { drawMark, robotColour } from "./looks";
import type { Grid, Robot, Vector, Zone } from "./protocol";
import { fromRobot } from "./sighting";
import { LOOK_MS } from "./staleness";
import type { Store } from "./store";
import { ZONE_LETTERS } from "./tiles";
import { emptyNote, waitText } from "./waiting";

const LAYERS = {
  map: "Map",
  zones: "Zones",
  paths: "Paths",
  robots: "Robots",
  marks: "Marks",
} as const;
type Layer = keyof typeof LAYERS;

export class MapView {
  readonly element: HTMLElement;
  private readonly surface: Surface;
  private readonly on = new Set(Object.keys(LAYERS) as Layer[]);
  private readonly grids = new Map<number, { grid: Grid; image: HTMLCanvasElement }>();
  private centre: [number, number] = [0, 0];
  private scale = 0;
  /** Until somebody moves it the map shows everything, however it grows. */
  private fitted = true;
  private pending = 0;
  /** Pictures of the map so far, for tests. */
  drawn = 0;

  constructor(
    private readonly store: Store,
    private readonly marked: (place: Vector) => void,
  ) {
    this.surface = new Surface("map", () => this.later());
    const tools = (Object.entries(LAYERS) as [Layer, string][]).map(([layer, text]) => {
      const b = button(text, `layer-${layer}`, () => {
        if (!this.on.delete(layer)) this.on.add(layer);
        mark(b, "aria-pressed", this.on.has(layer));
        this.later();
      });
      b.setAttribute("aria-pressed", "true");
      return b;
    });
    const fit = button("Fit", "fit", () => {
      this.scale = 0;
      this.fitted = true;
      this.later();
    });
    const { canvas } = this.surface;
    this.element = panel(
      "map",
      "Map",
      [h("div", { class: "choice", role: "group", "aria-label": "layers" }, ...tools), fit],
      h(
        "div",
        { class: "stage" },
        canvas,
        emptyNote(store, (now) =>
          this.grids.size > 0 || store.robots.some((robot) => robot.pose)
            ? ""
            : waitText(store, "scan with a place", now),
        ),
      ),
    );
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons === 0) return;
      this.fitted = false;
      this.centre = [
        this.centre[0] + event.movementY / this.scale,
        this.centre[1] - event.movementX / this.scale,
      ];
      this.later();
    });
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.fitted = false;
        this.scale = Math.max(2, Math.min(400, this.scale * Math.exp(-event.deltaY / 400)));
        this.later();
      },
      { passive: false },
    );
    const markHere = (event: MouseEvent): void => {
      const [x, y] = this.place(event.offsetX, event.offsetY);
      this.marked([x, y, this.store.robot?.pose?.[2] ?? 0]);
    };
    canvas.addEventListener("click", (event) => {
      if (store.armed) markHere(event);
    });
    canvas.addEventListener("dblclick", (event) => {
      if (!store.considered) markHere(event);
    });
    store.on("mark", () => {
      mark(this.element, "data-armed", store.armed);
      this.later();
    });
    for (const topic of ["state", "path", "select", "theme"] as const)
      store.on(topic, () => this.later());
    // By a timer: what is frozen tells nobody.
    setInterval(() => mark(this.element, "data-stale", store.frozen), LOOK_MS);
    store.on("map", (index) => this.grid(index as number));
    store.on("theme", () => {
      for (const index of this.grids.keys()) this.grid(index);
    });
  }

  /** Draws at most ten times a second. */
  later(): void {
    if (this.pending) return;
    this.pending = window.setTimeout(() => {
      this.pending = 0;
      this.store.beat.ask(this.draw);
    }, 100);
  }

  private screen(x: number, y: number): [number, number] {
    const { width, height } = this.surface;
    return [
      width / 2 + (y - this.centre[1]) * this.scale,
      height / 2 - (x - this.centre[0]) * this.scale,
    ];
  }

  /** For tests: the pixel of the canvas, from its left and its top, where a place is. */
  at(x: number, y: number): [number, number] {
    const [column, row] = this.screen(x, y);
    const scale = this.surface.canvas.width / this.surface.width;
    return [column * scale, row * scale];
  }

  private place(column: number, row: number): [number, number] {
    const { width, height } = this.surface;
    return [
      this.centre[0] - (row - height / 2) / this.scale,
      this.centre[1] + (column - width / 2) / this.scale,
    ];
  }

  private grid(index: number): void {
    const grid = this.store.slot(index).map;
    if (!grid) return;
    const image = h("canvas", { width: grid.columns, height: grid.rows });
    const g = image.getContext("2d");
    if (!g) return;
    const data = g.createImageData(grid.columns, grid.rows);
    const colours = [[0, 0, 0, 0], rgba(colour("free")), rgba(colour("wall"))];
    grid.cells.forEach((cell, i) => {
      data.data.set(colours[cell] ?? [0, 0, 0, 0], 4 * i);
    });
    g.putImageData(data, 0, 0);
    this.grids.set(index, { grid, image });
    this.later();
  }

  /** Chooses centre and scale so that everything is seen. */
  private fit(): void {
    const spots: [number, number][] = [];
    for (const { grid } of this.grids.values())
      spots.push(
        [grid.x, grid.y],
        [grid.x + grid.columns * grid.cell, grid.y + grid.rows * grid.cell],
      );
    for (const robot of this.store.robots)
      if (robot.pose) spots.push([robot.pose[0], robot.pose[1]]);
    for (const zone of this.store.state?.zones ?? []) spots.push(...zone.corners);
    if (spots.length === 0) spots.push([0, 0]);
    const range = (place: 0 | 1): [number, number] => {
      const values = spots.map((spot) => spot[place]);
      return [Math.min(...values) - 1.5, Math.max(...values) + 1.5];
    };
    const [[x0, x1], [y0, y1]] = [range(0), range(1)];
    this.centre = [(x0 + x1) / 2, (y0 + y1) / 2];
    this.scale = Math.min(this.surface.width / (y1 - y0), this.surface.height / (x1 - x0));
  }

  private readonly draw = (): void => {
    const { surface, store } = this;
    if (surface.width < 8) return;
    const g = surface.clear();
    this.drawn++;
    if ((this.scale === 0 || this.fitted) && store.state) this.fit();
    if (this.scale === 0) return;
    if (this.on.has("map"))
      for (const { grid, image } of this.grids.values()) this.drawGrid(g, grid, image);
    if (this.on.has("zones")) for (const zone of store.state?.zones ?? []) this.drawZone(g, zone);
    if (this.on.has("paths")) for (const robot of store.robots) this.drawPath(g, robot);
    if (this.on.has("marks")) this.drawMarks(g);
    this.drawConsidered(g);
    if (this.on.has("robots")) for (const robot of store.robots) this.drawRobot(g, robot);
    this.drawScale(g);
  };

  /** Columns of a grid run along x (north), rows along y (right): cell (c, r) begins at x + c cell, y + r cell. */
  private drawGrid(g: CanvasRenderingContext2D, grid: Grid, image: HTMLCanvasElement): void {
    const [left, bottom] = this.screen(grid.x, grid.y);
    const cell = grid.cell * this.scale;
    g.save();
    g.imageSmoothingEnabled = false;
    g.transform(0, -cell, cell, 0, left, bottom);
    g.drawImage(image, 0, 0);
    g.restore();
  }

  private drawZone(g: CanvasRenderingContext2D, zone: Zone): void {
    const corners = zone.corners.map(([x, y]) => this.screen(x, y));
    if (corners.length < 3) return;
    g.save();
    g.beginPath();
    for (const corner of corners) g.lineTo(...corner);
    g.closePath();
    g.fillStyle = g.strokeStyle = colour(`zone-${zone.colour}`);
    g.globalAlpha = 0.3;
    g.fill();
    g.globalAlpha = 0.9;
    g.lineWidth = 1.5;
    g.stroke();
    const middle = corners.reduce(
      (sum, c) =>
        [sum[0] + c[0] / corners.length, sum[1] + c[1] / corners.length] as [number, number],
      [0, 0],
    );
    g.globalAlpha = 0.9;
    g.fillStyle = colour("text");
    g.font = `600 ${rem(15)}px ${colour("font")}`;
    // Below the middle, which keeps its colour; beside a zone that has no room for it.
    const letter = ZONE_LETTERS[zone.colour] ?? "";
    const right = Math.max(...corners.map(([x]) => x));
    const low = Math.max(...corners.map(([, y]) => y));
    if (low - middle[1] > 26 && right - middle[0] > 8) {
      g.textAlign = "center";
      g.fillText(letter, middle[0], middle[1] + 22);
    } else g.fillText(letter, right + 3, middle[1] + 5);
    g.restore();
  }

  private drawPath(g: CanvasRenderingContext2D, robot: Robot): void {
    const { path } = this.store.slot(robot.index);
    if (!path || path.length < 4) return;
    g.strokeStyle = robotColour(robot.index);
    g.lineWidth = 1.5;
    g.globalAlpha = 0.7;
    g.beginPath();
    for (let i = 0; i + 1 < path.length; i += 2)
      g.lineTo(...this.screen(path[i] ?? 0, path[i + 1] ?? 0));
    g.stroke();
    g.globalAlpha = 1;
  }

  private drawMarks(g: CanvasRenderingContext2D): void {
    g.lineWidth = 2;
    g.font = `600 ${rem(11)}px ${colour("font")}`;
    (this.store.state?.marks ?? []).forEach((one, place) => {
      const [x, y] = this.screen(one.place[0], one.place[1]);
      g.strokeStyle = g.fillStyle = colour("mark");
      g.beginPath();
      g.moveTo(x - 6, y);
      g.lineTo(x + 6, y);
      g.moveTo(x, y - 6);
      g.lineTo(x, y + 6);
      g.stroke();
      g.fillText(`V${place + 1}`, x + 7, y - 4);
    });
  }

  /** Where a mark is about to go: a ring, and the way to it from the robot with its length. */
  private drawConsidered(g: CanvasRenderingContext2D): void {
    const { considered, robots } = this.store;
    if (!considered) return;
    const [x, y] = this.screen(considered.place[0], considered.place[1]);
    const pose = robots.find((one) => one.name === considered.robot)?.pose;
    g.save();
    g.strokeStyle = g.fillStyle = colour("mark");
    g.lineWidth = 2;
    if (pose) {
      g.setLineDash([5, 4]);
      g.beginPath();
      g.moveTo(...this.screen(pose[0], pose[1]));
      g.lineTo(x, y);
      g.stroke();
      g.setLineDash([]);
    }
    g.beginPath();
    g.arc(x, y, rem(8), 0, 2 * Math.PI);
    g.moveTo(x - rem(4), y);
    g.lineTo(x + rem(4), y);
    g.moveTo(x, y - rem(4));
    g.lineTo(x, y + rem(4));
    g.stroke();
    g.font = `600 ${rem(12)}px ${colour("font")}`;
    if (pose)
      g.fillText(
        `${fromRobot(pose, considered.place).distance.toFixed(1)} m`,
        x + rem(11),
        y + rem(4),
      );
    g.restore();
  }

  private drawRobot(g: CanvasRenderingContext2D, robot: Robot): void {
    if (!robot.pose) return;
    const [x, y] = this.screen(robot.pose[0], robot.pose[1]);
    const chosen = robot.name === this.store.selected;
    drawMark(g, robot.index, {
      x,
      y,
      radius: rem(chosen ? 7 : 6),
      edge: colour(chosen ? "text" : "panel"),
      width: chosen ? 2 : 1,
      heading: robot.pose[5],
    });
    g.fillStyle = colour("text");
    g.font = `${chosen ? 600 : 400} ${rem(11)}px ${colour("font")}`;
    g.fillText(robot.name, x + rem(11), y + rem(4));
  }

  private drawScale(g: CanvasRenderingContext2D): void {
    const metres = [1, 2, 5, 10, 20, 50].find((m) => m * this.scale > 50) ?? 100;
    const { height } = this.surface;
    g.fillStyle = g.strokeStyle = colour("quiet");
    g.lineWidth = 1.5;
    g.beginPath();
    g.moveTo(10, height - 14);
    g.lineTo(10, height - 9);
    g.lineTo(10 + metres * this.scale, height - 9);
    g.lineTo(10 + metres * this.scale, height - 14);
    g.stroke();
    g.font = `${rem(11)}px ${colour("font")}`;
    g.fillText(`${metres} m`, 15, height - 14);
  }
}

function rgba(text: string): number[] {
  const n = Number.parseInt(text.slice(1), 16);
  return [(n >> 16) & 255, (n >> 8) & 255, n & 255, 255];
}
