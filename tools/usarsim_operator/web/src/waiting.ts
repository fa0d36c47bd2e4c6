// What a panel says while it has nothing to show: how far the page has come, and what is waited for.

import { h, say } from "./dom";
import { LOOK_MS } from "./staleness";
import { pageTime, type Store } from "./store";

type Known = Pick<Store, "connected" | "refused" | "welcome" | "welcomed" | "state" | "robots">;

/** What is waited for before any robot is known; empty afterwards. `now`: page time, s. */
export function newsText(store: Known, now: number): string {
  if (!store.state && !store.connected) return store.refused || "connecting to the gateway";
  if (!store.state) {
    const late = store.welcome?.delay_s ?? 0;
    if (late === 0) return "connected, waiting for first news";
    const left = Math.max(0, Math.ceil(store.welcomed + late - now));
    return `connected; this page sees all ${late} s late, first news in ${left} s`;
  }
  if (store.robots.length > 0) return "";
  return `connected, ${store.state.paused ? "server paused, " : ""}no robot has come yet`;
}

/** What is waited for where `what` (`picture of R1`) has not come yet. */
export function waitText(store: Known, what: string, now: number): string {
  const paused = store.state?.paused ? "server paused, " : "";
  return newsText(store, now) || `${paused}waiting for first ${what}`;
}

/** A note in the middle of a panel; `text` says why the panel is empty, nothing where it is not. */
export function emptyNote(store: Store, text: (now: number) => string): HTMLElement {
  const note = h("p", { class: "empty", "data-empty": true });
  const draw = (): void => {
    const why = text(pageTime());
    say(note, why);
    note.hidden = why === "";
  };
  for (const topic of ["state", "link", "welcome", "select"] as const) store.on(topic, draw);
  setInterval(draw, LOOK_MS);
  queueMicrotask(draw); // when the panel around it is made
  return note;
}
