// Who knows how much: lines of team, base and robots over all steps, and where the picture is.

import { points } from "./run";

const SVG = "http://www.w3.org/2000/svg";

export class Chart {
  readonly svg = document.createElementNS(SVG, "svg");
  private readonly lines: SVGPolylineElement[] = [];
  private readonly now = document.createElementNS(SVG, "line");

  constructor(robots: number) {
    this.svg.classList.add("chart");
    this.svg.setAttribute("viewBox", "0 0 100 100");
    this.svg.setAttribute("preserveAspectRatio", "none");
    this.svg.setAttribute("role", "img");
    this.svg.setAttribute("aria-label", "percent known by step");
    for (let i = 0; i < robots + 2; i++) {
      const line = document.createElementNS(SVG, "polyline");
      if (i < 2) line.classList.add(i === 0 ? "team" : "base");
      this.lines.push(line);
    }
    this.now.classList.add("now");
    this.now.setAttribute("y1", "0");
    this.now.setAttribute("y2", "100");
    // robots first, so that team and base lie above them
    this.svg.append(...[...this.lines].reverse(), this.now);
  }

  /** New values, by step. */
  fill(shares: readonly number[][]): void {
    this.lines.forEach((line, i) => {
      line.setAttribute("points", points(shares.map((row) => row[i] ?? 0)));
    });
  }

  /** Where the picture is. */
  point(step: number, last: number): void {
    const x = String((100 * step) / Math.max(last, 1));
    this.now.setAttribute("x1", x);
    this.now.setAttribute("x2", x);
  }
}
