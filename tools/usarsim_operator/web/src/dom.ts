// Small helpers to build and change the page. Texts go in as text nodes only, never as markup.

import { graphics } from "./gl";

type Child = Node | string | null;
type Attributes = Record<string, string | number | boolean | ((event: Event) => void)>;

/** Makes an element; keys `on...` are listeners, true sets an empty attribute, false leaves it out. */
export function h<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name.slice(2), value);
    else if (value !== false) element.setAttribute(name, value === true ? "" : String(value));
  }
  element.append(...children.filter((child) => child !== null));
  return element;
}

/** Changes a text only when it differs, so that nothing is laid out again for nothing. */
export function say(element: Element, text: string): void {
  if (element.textContent !== text) element.textContent = text;
}

/** Sets or removes an attribute only when it differs; booleans become "true" and "false". */
export function mark(element: Element, name: string, value: string | boolean | null): void {
  if (value === null) element.removeAttribute(name);
  else if (element.getAttribute(name) !== String(value)) element.setAttribute(name, String(value));
}

export function button(text: string, data: string, act: () => void, title = ""): HTMLButtonElement {
  const attributes: Attributes = { type: "button", "data-do": data, onclick: act };
  if (title !== "") attributes.title = title;
  return h("button", attributes, text);
}

/** A panel of the grid: a section with a heading, tools on its right, and a body. */
export function panel(name: string, title: string, tools: Child[], ...body: Child[]): HTMLElement {
  return h(
    "section",
    { class: "panel", "data-panel": name, "aria-label": title },
    h("div", { class: "panel-head" }, h("h2", {}, title), h("div", { class: "tools" }, ...tools)),
    ...body,
  );
}

/** A group of buttons of which one is chosen. */
export function choice<T extends string>(
  label: string,
  options: Record<T, string>,
  first: NoInfer<T>,
  chosen: (value: T) => void,
): HTMLElement & { set: (value: T) => void } {
  const buttons = Object.entries<string>(options).map(([value, text]) =>
    button(text, `choose-${value}`, () => {
      set(value as T);
      chosen(value as T);
    }),
  );
  const group = h("div", { class: "choice", role: "group", "aria-label": label }, ...buttons);
  const set = (value: T): void => {
    for (const b of buttons) mark(b, "aria-pressed", b.dataset.do === `choose-${value}`);
  };
  set(first);
  return Object.assign(group, { set });
}

/** What draws on a canvas: in memory where there is no graphics card, whose copy would be another one's work. */
export function flat(canvas: HTMLCanvasElement): CanvasRenderingContext2D | null {
  return canvas.getContext("2d", { willReadFrequently: graphics().software });
}

/** Makes a canvas as sharp as the screen; calls `drawn` when its size changes. */
export class Surface {
  readonly canvas: HTMLCanvasElement;
  readonly context: CanvasRenderingContext2D;
  width = 1;
  height = 1;

  constructor(label: string, resized: () => void) {
    this.canvas = h("canvas", { role: "img", "aria-label": label });
    const context = flat(this.canvas);
    if (!context) throw new Error("no 2D canvas");
    this.context = context;
    new ResizeObserver(() => {
      const scale = Math.min(window.devicePixelRatio, 2);
      this.width = this.canvas.clientWidth;
      this.height = this.canvas.clientHeight;
      this.canvas.width = Math.max(1, Math.round(this.width * scale));
      this.canvas.height = Math.max(1, Math.round(this.height * scale));
      context.setTransform(scale, 0, 0, scale, 0, 0);
      resized();
    }).observe(this.canvas);
  }

  clear(): CanvasRenderingContext2D {
    this.context.clearRect(0, 0, this.width, this.height);
    return this.context;
  }
}

let root = 0;
globalThis.addEventListener?.("resize", () => {
  root = 0;
});

/** px on this screen of a size that is `px` where a rem is 16 px, for what is not laid out by style sheets. */
export function rem(px: number): number {
  root ||= Number.parseFloat(getComputedStyle(document.documentElement).fontSize);
  return (px * root) / 16;
}

const cache = new Map<string, string>();

/** A colour of style.css by its custom property's name; remembered until the theme changes. */
export function colour(name: string): string {
  let value = cache.get(name);
  if (value === undefined) {
    value = getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
    cache.set(name, value);
  }
  return value;
}

export function forgetColours(): void {
  cache.clear();
}
