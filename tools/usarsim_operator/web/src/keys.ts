// The dialog for keys and pad: every action with its keys, changed by pressing a key, exported and imported as
// TOML.

import {
  ACTIONS,
  type Action,
  AXES,
  type Bindings,
  check,
  defaults,
  fromToml,
  PAD_ACTIONS,
  type PadAction,
  toToml,
} from "./bindings";
import { dialog } from "./dialog";
import { button, h, mark, say } from "./dom";
import { codeOf } from "./keyboard";
import type { KeyNames } from "./keynames";
import type { Store } from "./store";
import { save } from "./tiles";

const KEPT = "usarsim-bindings";
/** Of a study: the next participant at this browser begins with the keys that all begin with. */
const KEPT_OF_SESSION = "usarsim-session-bindings";

interface Kept {
  session: string;
  toml: string;
}

/** Keys as they were left here; in a session of a study only those of the same session. */
export function savedBindings(session: string): Bindings {
  const text = session === "" ? localStorage.getItem(KEPT) : ofSession(session);
  try {
    return text === null ? defaults() : fromToml(text);
  } catch {
    return defaults();
  }
}

function ofSession(session: string): string | null {
  try {
    const kept: Partial<Kept> | null = JSON.parse(localStorage.getItem(KEPT_OF_SESSION) ?? "null");
    return kept?.session === session ? String(kept.toml) : null;
  } catch {
    return null;
  }
}

function keep(session: string, toml: string): void {
  if (session === "") localStorage.setItem(KEPT, toml);
  else localStorage.setItem(KEPT_OF_SESSION, JSON.stringify({ session, toml } satisfies Kept));
}

export function keysDialog(
  store: Store,
  session: string,
  current: Bindings,
  apply: (bindings: Bindings) => void,
): void {
  const names = store.keys;
  let draft = structuredClone(current);
  const wrong = h("p", { class: "fault", role: "alert", "data-error": true });
  const table = h("div", { class: "binding-table" });
  const attempt = (next: Bindings): void => {
    try {
      check(next, (code) => names.exact(code));
      draft = next;
      say(wrong, "");
      fill();
    } catch (error) {
      say(wrong, error instanceof Error ? error.message : String(error));
    }
  };
  const fill = (): void => {
    table.replaceChildren(
      h("h3", {}, "Keys"),
      ...(Object.keys(ACTIONS) as Action[]).map((action) => keyRow(names, action, draft, attempt)),
      h("h3", {}, "Pad"),
      ...(Object.keys(PAD_ACTIONS) as PadAction[]).map((action) =>
        padRow(PAD_ACTIONS[action], action, "buttons", draft, attempt),
      ),
      ...AXES.map((axis) => padRow(`stick: ${axis}`, axis, "axes", draft, attempt)),
    );
  };
  const file = h("input", {
    type: "file",
    accept: ".toml",
    hidden: true,
    "data-do": "import-file",
  });
  file.addEventListener("change", async () => {
    try {
      attempt(fromToml((await file.files?.[0]?.text()) ?? ""));
    } catch (error) {
      say(wrong, error instanceof Error ? error.message : String(error));
    }
    file.value = "";
  });
  const tools = h(
    "div",
    { class: "tools" },
    button("Export", "export", () =>
      save(new Blob([toToml(draft)], { type: "application/toml" }), "usarsim-keys.toml"),
    ),
    button("Import", "import", () => file.click()),
    file,
    button("Defaults", "defaults", () => attempt(defaults())),
  );
  fill();
  const fixed = h(
    "p",
    { class: "quiet" },
    "Fixed: 1 to 9 and 0 choose a robot, Esc twice stops everything. Click a key to change it.",
  );
  const element = dialog("Keys and pad", [fixed, table, wrong, tools], "Save", () => {
    keep(session, toToml(draft));
    apply(draft);
    store.tell("notice", "keys and pad saved");
  });
  element.classList.add("wide");
}

function keyRow(
  names: KeyNames,
  action: Action,
  draft: Bindings,
  attempt: (next: Bindings) => void,
): HTMLElement {
  const change = (place: number, code: string | null): void => {
    const next = structuredClone(draft);
    if (code === null) next.keys[action].splice(place, 1);
    else next.keys[action][place] = code;
    attempt(next);
  };
  const keys = [...draft.keys[action], ""].slice(0, 2).map((code, place) => {
    const b = button(code ? names.name(code) : "+", `key-${action}-${place}`, () => {
      say(b, "press a key");
      mark(b, "data-listens", true);
      const hear = (event: KeyboardEvent): void => {
        event.preventDefault();
        event.stopPropagation();
        say(b, code ? names.name(code) : "+");
        mark(b, "data-listens", null);
        const pressed = codeOf(event);
        if (pressed === "Escape") return;
        change(place, pressed === "Delete" || pressed === "Backspace" ? null : pressed);
      };
      b.addEventListener("keydown", hear, { once: true });
    });
    b.classList.add("key");
    b.setAttribute("aria-label", `${ACTIONS[action]}: ${code ? names.name(code) : "no key"}`);
    return b;
  });
  return h(
    "div",
    { class: "binding", "data-binding": action },
    h("span", {}, ACTIONS[action]),
    ...keys,
  );
}

function padRow(
  label: string,
  name: string,
  table: "buttons" | "axes",
  draft: Bindings,
  attempt: (next: Bindings) => void,
): HTMLElement {
  const numbers = draft[table] as Record<string, number>;
  const input = h("input", {
    type: "number",
    min: 0,
    max: 99,
    value: numbers[name] ?? 0,
    "data-pad": name,
    "aria-label": label,
  });
  input.addEventListener("change", () => {
    const next = structuredClone(draft);
    (next[table] as Record<string, number>)[name] = Math.round(Number(input.value));
    attempt(next);
    input.value = String(numbers[name] ?? 0);
  });
  return h("div", { class: "binding", "data-binding": name }, h("span", {}, label), input);
}
