// Before a trial begins: what this page still needs for it, and the bar that says so. A pad has to answer, since browsers
// show none before a button is pressed; and who drives has to see.

import { h, mark, say } from "./dom";
import type { Link } from "./link";
import { LOOK_MS } from "./staleness";
import type { Store } from "./store";

type Known = Pick<Store, "welcome" | "robot" | "slot">;

/** What is missing: an answer of the pad, a picture of the chosen robot, or nothing. */
export function missingFor(store: Known, padAnswered: boolean): "pad" | "robot" | "picture" | null {
  if (store.welcome?.device === "gamepad" && !padAnswered) return "pad";
  const { robot } = store;
  if (!robot || robot.learned === false) return "robot";
  return robot.camera?.on && !store.slot(robot.index).picture ? "picture" : null;
}

/** Tells the gateway when this page is ready, and no longer so; shows why not while a trial waits. */
export function readyBar(store: Store, link: Link, input: { padAnswered: boolean }): HTMLElement {
  const text = h("p", { role: "status" });
  const element = h("div", { class: "ready-bar", "data-wants": "robot", hidden: true }, text);
  let told = false;
  store.on("welcome", () => {
    told = false;
  });
  const look = (): void => {
    const missing = missingFor(store, input.padAnswered);
    const ready = missing === null;
    if (
      store.welcome?.role === "operator" &&
      ready !== told &&
      link.send({ type: "ready", on: ready })
    )
      told = ready;
    mark(element, "data-wants", missing ?? "nothing");
    element.hidden = !(store.state?.waits && store.welcome?.role === "operator");
    const first = `the first picture of ${store.robot?.name}`;
    say(
      text,
      missing === "pad"
        ? "Press any button on the gamepad: it begins when the pad answers."
        : missing === "picture"
          ? `It begins when ${first} has come.`
          : missing === "robot"
            ? "It begins when the robots are there."
            : "Ready. It begins when everybody is.",
    );
  };
  for (const topic of ["state", "picture", "select", "welcome"] as const) store.on(topic, look);
  setInterval(look, LOOK_MS);
  return element;
}
