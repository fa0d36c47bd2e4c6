// Two sticks for thumbs: the left one drives (forward, turn), the right one is for aircraft (up, sideways).
// Dead zone, curve and mixing are those of the pad; letting go stops.

import { h, mark } from "./dom";
import type { Input } from "./input";
import { stick } from "./mixing";
import type { Store } from "./store";

class Stick {
  readonly element: HTMLElement;
  private readonly knob = h("div", { class: "knob" });
  x = 0;
  y = 0;

  constructor(name: string, label: string, changed: () => void) {
    this.element = h(
      "div",
      { class: "stick", "data-stick": name, role: "img", "aria-label": label },
      this.knob,
    );
    const move = (event: PointerEvent): void => {
      const box = this.element.getBoundingClientRect();
      const x = (2 * (event.clientX - box.left)) / box.width - 1;
      const y = (2 * (event.clientY - box.top)) / box.height - 1;
      const long = Math.max(1, Math.hypot(x, y));
      this.set(x / long, y / long);
      changed();
    };
    const release = (): void => {
      this.set(0, 0);
      changed();
    };
    this.element.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      this.element.setPointerCapture(event.pointerId);
      move(event);
    });
    this.element.addEventListener("pointermove", (event) => {
      if (this.element.hasPointerCapture(event.pointerId)) move(event);
    });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"])
      this.element.addEventListener(end, release);
  }

  private set(x: number, y: number): void {
    this.x = x;
    this.y = y;
    this.knob.style.transform = `translate(${85 * x}%, ${85 * y}%)`;
  }
}

export function touchSticks(store: Store, input: Input): HTMLElement {
  const changed = (): void => {
    const [turn, forward] = stick(left.x, left.y);
    const [side, up] = stick(right.x, right.y);
    const flies = store.robot?.kind === "aerial";
    input.touch = { forward: 0 - forward, turn, up: flies ? 0 - up : 0, side: flies ? side : 0 };
    input.tick();
  };
  const left = new Stick("drive", "drive: forward and turn", changed);
  const right = new Stick("fly", "fly: up and sideways", changed);
  const element = h("div", { class: "sticks", "data-touch": true }, left.element, right.element);
  store.on("welcome", () => {
    element.hidden = (store.welcome?.device ?? "any") !== "any";
  });
  store.on("state", () => mark(element, "data-flies", store.robot?.kind === "aerial"));
  return element;
}
