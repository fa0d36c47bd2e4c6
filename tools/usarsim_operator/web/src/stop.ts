// The emergency stop. Its button only ever stops, however often it is pressed. Releasing is another act at another place:
// a button below the header that has to be held for a second.

import { dialog } from "./dialog";
import { h, mark, say } from "./dom";
import type { Link } from "./link";
import { clockText } from "./staleness";
import { pageTime, type Store } from "./store";

/** s that the button is held until it releases. */
export const HOLD_S = 1;
/** s between two looks at a held button, and the most that counts of one: a page that hangs holds nothing. */
const LOOK_S = 0.05;
const MOST_S = 0.15;

/** Stops every robot; what is stopped stays so. */
export function stopAll(link: Link): void {
  link.request({ type: "estop" });
}

/** The button. */
export function stopButton(store: Store, link: Link): HTMLElement {
  const element = h(
    "button",
    { type: "button", class: "estop", "data-do": "estop", "aria-pressed": "false" },
    "Stop",
  );
  element.addEventListener("click", () => stopAll(link));
  const draw = (): void => {
    const stop = store.state?.estop;
    mark(element, "aria-pressed", !!stop);
    mark(document.documentElement, "data-estop", !!stop);
    say(element, stop ? `Stopped by ${stop.by}` : "Stop");
    element.title = `${store.keys.of("estop")}, or Esc twice; stops every robot`;
    element.hidden = store.welcome?.role === "viewer";
  };
  for (const topic of ["state", "welcome", "bindings"] as const) store.on(topic, draw);
  draw();
  return element;
}

/** The bar that says who has stopped everything, with the button that releases. */
export function stopBar(store: Store, link: Link): HTMLElement {
  const text = h("p", { role: "status" });
  const release = holdButton(
    "Release: hold for 1 s",
    () => link.request({ type: "estop_reset" }),
    () => store.tell("notice", "hold the button for a second to release the stop"),
  );
  mark(release, "data-do", "release");
  const element = h(
    "div",
    { class: "stop-bar", "data-stopped": true, hidden: true },
    release,
    text,
  );
  const draw = (): void => {
    const stop = store.state?.estop;
    element.hidden = !stop;
    release.hidden = store.welcome?.role === "viewer";
    say(
      text,
      stop ? `Every robot is stopped, by ${stop.by} at ${clockText(store.mission(stop.time))}` : "",
    );
  };
  for (const topic of ["state", "welcome"] as const) store.on(topic, draw);
  return element;
}

/**
 * A button that acts when mouse, finger or Enter has held it for a second, and says so when it was held shorter. What
 * presses a button without holding it, as screen readers do, is asked by a dialog.
 */
function holdButton(label: string, act: () => void, short: () => void): HTMLButtonElement {
  const element = h("button", { type: "button", class: "hold" }, label);
  let timer = 0;
  let held = 0;
  let looked = 0;
  const show = (): void => element.style.setProperty("--held", String(Math.min(1, held / HOLD_S)));
  const end = (): void => {
    clearInterval(timer);
    timer = held = 0;
    show();
  };
  const begin = (): void => {
    if (timer) return;
    looked = pageTime();
    timer = window.setInterval(() => {
      held += Math.min(MOST_S, pageTime() - looked);
      looked = pageTime();
      show();
      if (held < HOLD_S) return;
      end();
      act();
    }, 1000 * LOOK_S);
  };
  const letGo = (): void => {
    if (timer) short();
    end();
  };
  element.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    element.setPointerCapture(event.pointerId);
    begin();
  });
  element.addEventListener("pointermove", (event) => {
    const { left, right, top, bottom } = element.getBoundingClientRect();
    const { clientX: x, clientY: y } = event;
    if (x < left || x > right || y < top || y > bottom) end();
  });
  element.addEventListener("pointerup", letGo);
  for (const lost of ["pointercancel", "lostpointercapture", "blur"] as const)
    element.addEventListener(lost, end);
  element.addEventListener("contextmenu", (event) => event.preventDefault());
  element.addEventListener("keydown", (event) => {
    if (event.key !== "Enter") return;
    event.preventDefault();
    if (!event.repeat) begin();
  });
  element.addEventListener("keyup", (event) => {
    if (event.key === "Enter") letGo();
  });
  element.addEventListener("click", (event) => {
    if (event.detail > 0) return;
    const body = [h("p", {}, "Robots that somebody drives go on at once.")];
    dialog("Release the emergency stop?", body, "Release", act, "Stay stopped");
  });
  return element;
}
