// For a pad without the standard layout: asks for each control by name, one after the other, and keeps what was
// found for pads of that name.

import { type Axis, PAD_ACTIONS, type PadAction } from "./bindings";
import { dialog } from "./dialog";
import { button, h, mark, say } from "./dom";
import type { PadMap, PadMaps } from "./pad";

const KEPT = "usarsim-pads";
/** How far from its rest an axis must be moved to be the one that is meant; triggers rest at -1. */
const MOVED = 0.7;

/** Which way each stick is asked for, and which sign that has on a pad of the standard layout. */
const WAYS: Record<Axis, [text: string, sign: 1 | -1]> = {
  forward: ["Push the driving stick forward", -1],
  turn: ["Push the driving stick to the right", 1],
  up: ["Push the other stick forward (climb)", -1],
  side: ["Push the other stick to the right", 1],
};

/** No control yet for any of these. */
function none<K extends string>(names: string[]): Record<K, number> {
  return Object.fromEntries(names.map((name) => [name, -1])) as Record<K, number>;
}

export function savedPads(): PadMaps {
  try {
    const maps: unknown = JSON.parse(localStorage.getItem(KEPT) ?? "{}");
    const isMap = (map: PadMap | null): boolean => !!map?.buttons && !!map.axes;
    return Object.fromEntries(
      Object.entries(maps as Record<string, PadMap>).filter(([, map]) => isMap(map)),
    );
  } catch {
    return {};
  }
}

/** Asks for all controls of a pad; `maps` gets its map, now and for later visits. */
export function remapDialog(pad: Gamepad, maps: PadMaps): void {
  if (document.querySelector("dialog[data-remap]")) return;
  const map: PadMap = { buttons: none(Object.keys(PAD_ACTIONS)), axes: none(Object.keys(WAYS)) };
  const reversed = new Set<Axis>();
  const used = { axes: new Set<number>(), buttons: new Set<number>() };
  const rest = [...pad.axes];
  const steps: (Axis | PadAction)[] = [
    ...(Object.keys(WAYS) as Axis[]),
    ...(Object.keys(PAD_ACTIONS) as PadAction[]),
  ];
  const isAxis = (name: Axis | PadAction): name is Axis => Object.hasOwn(WAYS, name);
  const ask = h("p", { "data-ask": true, role: "status" });
  const skip = button("This pad has none", "skip", () => next());
  let step = -1;
  const next = (): void => {
    step += 1;
    const at = steps[step];
    mark(ask.closest("dialog") ?? ask, "data-step", String(step));
    if (at === undefined) say(ask, "All set.");
    else say(ask, isAxis(at) ? `${WAYS[at][0]}.` : `Press the button for "${PAD_ACTIONS[at]}".`);
    skip.disabled = at === undefined;
  };
  next();

  const look = (): void => {
    const now = navigator.getGamepads()[pad.index];
    const at = steps[step];
    if (!now || at === undefined) return;
    if (isAxis(at)) {
      const moved = (axis: number): number => (now.axes[axis] ?? 0) - (rest[axis] ?? 0);
      const found = now.axes.findIndex((_, i) => Math.abs(moved(i)) > MOVED && !used.axes.has(i));
      if (found < 0) return;
      used.axes.add(found);
      map.axes[at] = found;
      if (Math.sign(moved(found)) !== WAYS[at][1]) reversed.add(at);
    } else {
      const found = now.buttons.findIndex((b, i) => b.pressed && !used.buttons.has(i));
      if (found < 0) return;
      used.buttons.add(found);
      map.buttons[at] = found;
    }
    next();
  };
  const timer = setInterval(look, 30);
  const name = h("p", { class: "quiet" }, `${pad.id}: not of the standard layout`);
  const element = dialog("Set up this pad", [name, ask, skip], "Save", () => {
    maps[pad.id] = { ...map, reversed: [...reversed] };
    localStorage.setItem(KEPT, JSON.stringify(maps));
  });
  mark(element, "data-remap", pad.id);
  mark(element, "data-step", String(step));
  element.addEventListener("close", () => clearInterval(timer));
}
