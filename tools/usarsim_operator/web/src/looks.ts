// How each robot looks wherever it is drawn or listed: a colour and a mark, by its number. Thirty in a row have thirty
// looks. Colours with one mark are told apart with every kind of colour vision, the marks without any.

/** Six of Wong's colours. */
const COLOURS = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00"];

/** Outlines around 0, 0 with a radius of about 1, y downwards. */
const SHAPES = {
  circle: "M1 0A1 1 0 1 1-1 0A1 1 0 1 1 1 0Z",
  square: "M-.88-.88H.88V.88H-.88Z",
  triangle: "M0-1.15L1.1 .8H-1.1Z",
  cross: "M-.38-1H.38V-.38H1V.38H.38V1H-.38V.38H-1V-.38H-.38Z",
  hourglass: "M-1-1H1L.3 0L1 1H-1L-.3 0Z",
};
export type Shape = keyof typeof SHAPES;
const NAMES = Object.keys(SHAPES) as Shape[];

export interface Look {
  colour: string;
  shape: Shape;
}

/** Of robot number `index`, from 0 on. */
export function robotLook(index: number): Look {
  return {
    colour: COLOURS[index % COLOURS.length] ?? "",
    shape: NAMES[index % NAMES.length] ?? "circle",
  };
}

export function robotColour(index: number): string {
  return robotLook(index).colour;
}

const paths = new Map<Shape, Path2D>();

/**
 * Draws a robot's mark of a radius in px, with an edge; `heading` (rad, clockwise from up) adds a nose that points
 * there.
 */
export function drawMark(
  g: CanvasRenderingContext2D,
  index: number,
  {
    x,
    y,
    radius,
    edge,
    width = 1,
    heading,
  }: {
    x: number;
    y: number;
    radius: number;
    edge: string;
    width?: number;
    heading?: number;
  },
): void {
  const { colour, shape } = robotLook(index);
  const path = paths.get(shape) ?? new Path2D(SHAPES[shape]);
  paths.set(shape, path);
  g.save();
  g.translate(x, y);
  g.fillStyle = colour;
  g.strokeStyle = edge;
  g.lineJoin = "round";
  g.scale(radius, radius);
  g.lineWidth = width / radius;
  if (heading !== undefined) {
    g.save();
    g.rotate(heading);
    g.beginPath();
    g.moveTo(0, -2.1);
    g.lineTo(0.75, -0.9);
    g.lineTo(-0.75, -0.9);
    g.closePath();
    g.fill();
    g.stroke();
    g.restore();
  }
  g.fill(path);
  g.stroke(path);
  g.restore();
}

const SVG = "http://www.w3.org/2000/svg";

/** A robot's mark for lists and titles; `setMark` says whose. */
export function markIcon(index?: number): SVGElement {
  const icon = document.createElementNS(SVG, "svg");
  icon.setAttribute("class", "robot-mark");
  icon.setAttribute("viewBox", "-1.25 -1.25 2.5 2.5");
  icon.setAttribute("aria-hidden", "true");
  icon.append(document.createElementNS(SVG, "path"));
  if (index !== undefined) setMark(icon, index);
  return icon;
}

export function setMark(icon: Element, index: number): void {
  const { colour, shape } = robotLook(index);
  const look = `${shape} ${colour}`;
  if (icon.getAttribute("data-look") === look) return;
  icon.setAttribute("data-look", look);
  icon.firstElementChild?.setAttribute("d", SHAPES[shape]);
  icon.firstElementChild?.setAttribute("fill", colour);
}
