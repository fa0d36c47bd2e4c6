// Marks of victims: choosing a place by click, touch or keyboard, and showing where it is before it is set.

import { dialog } from "./dialog";
import { button, h, mark, say } from "./dom";
import type { Link } from "./link";
import type { Pose, Robot, Vector } from "./protocol";
import { fromRobot, placeFrom } from "./sighting";
import type { Store } from "./store";

export const STATUSES = ["unknown", "alive", "unconscious", "dead"];

/** Where a place is from a robot, for people: `2.4 m from R1, 12° to the right`. */
export function whereText(robot: Pick<Robot, "name" | "pose">, place: Vector): string {
  if (!robot.pose) return `at ${place[0].toFixed(1)}, ${place[1].toFixed(1)} m`;
  const { distance, bearing } = fromRobot(robot.pose, place);
  const degrees = Math.round((180 * bearing) / Math.PI);
  const side =
    degrees === 0
      ? "straight ahead"
      : `${Math.abs(degrees)}° to the ${degrees > 0 ? "right" : "left"}`;
  return `${distance.toFixed(1)} m from ${robot.name}, ${side}`;
}

/** The button that makes the next click or tap into a picture or the map a mark, without a double click. */
export function markButton(store: Store): HTMLButtonElement {
  const b = button("Mark", "mark", () => store.arm(!store.armed), "mark where the next click goes");
  store.on("mark", () => mark(b, "aria-pressed", store.armed));
  store.on("welcome", () => {
    b.hidden = store.welcome?.role === "viewer";
  });
  mark(b, "aria-pressed", false);
  return b;
}

/** Asks for status and note of a new mark at a place, or of one that is there. */
export function markDialog(
  store: Store,
  link: Link,
  target: { place: Vector; guessed?: boolean } | { id: number },
): void {
  const old = "id" in target ? store.state?.marks.find((one) => one.id === target.id) : undefined;
  const status = h(
    "select",
    { "data-field": "status" },
    ...STATUSES.map((s) => h("option", { value: s }, s)),
  );
  const note = h("input", { type: "text", maxlength: 200, "data-field": "note" });
  if (old) {
    status.value = old.status;
    note.value = old.note;
  }
  const by = old?.robot ?? store.selected;
  const body: Node[] = [h("label", {}, "Status", status), h("label", {}, "Note", note)];
  let place = "place" in target ? target.place : old?.place;
  const first = place;
  const done = (): void => store.consider(null);
  const element = dialog(
    "Victim",
    body,
    old ? "Save" : "Mark",
    () => {
      done();
      const moved = place !== first && place ? { place } : {};
      const facts = { status: status.value, note: note.value };
      if ("id" in target) link.request({ type: "mark_edit", mark: target.id, ...facts, ...moved });
      else link.request({ type: "mark", robot: by, place, ...facts });
    },
    "Cancel",
    done,
  );
  element.closest(".veil")?.classList.add("aside"); // map and picture show where
  const move = (next: Vector): void => {
    place = next;
  };
  const guessed = "guessed" in target && target.guessed === true;
  if (place) note.parentElement?.after(...placeFields(store, by, place, guessed, move));
}

/** Distance and direction from the robot, which keys change; map and picture follow. */
function placeFields(
  store: Store,
  by: string,
  first: Vector,
  guessed: boolean,
  changed: (place: Vector) => void,
): Node[] {
  const robot = store.robots.find((one) => one.name === by);
  // As it was when the place was chosen: a robot that moves must not take the mark along.
  const pose: Pose | null = robot?.pose ? [...robot.pose] : null;
  const where = h("p", { class: "quiet", "data-mark-where": true, role: "status" });
  const show = (place: Vector): void => {
    const why = guessed ? " (a guess: the laser sees nothing there)" : "";
    say(where, whereText({ name: by, pose }, place) + why);
    store.consider({ robot: by, place });
  };
  show(first);
  if (!pose) return [where];
  const { distance, bearing } = fromRobot(pose, first);
  const metres = h("input", {
    type: "number",
    min: 0,
    max: 100,
    step: 0.1,
    "data-field": "distance",
  });
  const degrees = h("input", {
    type: "number",
    min: -180,
    max: 180,
    step: 1,
    "data-field": "bearing",
  });
  metres.value = distance.toFixed(1);
  degrees.value = String(Math.round((180 * bearing) / Math.PI));
  const move = (): void => {
    const turn = (Math.PI * degrees.valueAsNumber) / 180;
    if (!Number.isFinite(metres.valueAsNumber) || !Number.isFinite(turn)) return;
    guessed = false;
    const place = placeFrom(pose, metres.valueAsNumber, turn, first[2]);
    changed(place);
    show(place);
  };
  for (const field of [metres, degrees]) field.addEventListener("input", move);
  return [
    where,
    h("label", {}, "Distance, m", metres),
    h("label", {}, "Direction, ° to the right", degrees),
  ];
}
