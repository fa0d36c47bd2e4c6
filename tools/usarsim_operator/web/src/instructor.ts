// What an instructor does to a session: bring the robots of a scenario file and let them go, and make things happen.

import { button, h } from "./dom";
import type { Link } from "./link";
import { listbox } from "./listbox";
import { row } from "./more";
import type { Store } from "./store";

type Fields = { [key: string]: unknown };

/** Rows for the disclosure of the chosen robot; hidden from everybody else. */
export function instructing(store: Store, link: Link): HTMLElement[] {
  const rows = [
    row("Scenario", scenarioTools(store, link)),
    ...injectTools(store, link).map(([label, tools]) => row(label, tools)),
  ];
  const update = (): void => {
    for (const one of rows) one.hidden = store.welcome?.role !== "instructor";
  };
  update();
  store.on("welcome", update);
  return rows;
}

function scenarioTools(store: Store, link: Link): HTMLElement[] {
  const file = h("input", {
    type: "file",
    accept: ".toml",
    "data-field": "scenario",
    "aria-label": "scenario file",
    hidden: true,
  });
  file.addEventListener("change", async () => {
    const text = await file.files?.[0]?.text();
    file.value = "";
    if (text !== undefined) link.request({ type: "load", scenario: text });
  });
  const load = button("Load…", "load", () => file.click(), "robots of a scenario file come");
  const close = button(
    "Close",
    "close",
    async () => {
      if (await link.request({ type: "close" })) store.tell("notice", "all robots have gone");
    },
    "all robots of this gateway go",
  );
  return [file, load, close];
}

function injectTools(store: Store, link: Link): [string, HTMLElement[]][] {
  const lasts = h("input", { type: "number", min: 0, max: 86400, step: "any", value: 0 });
  lasts.setAttribute("aria-label", "s that a fault or a call lasts; 0: for good");
  const seconds = (): Fields => (Number(lasts.value) > 0 ? { lasts: Number(lasts.value) } : {});
  const inject = (name: string, fields: Fields): Promise<boolean> =>
    link.request({ type: "inject", do: name, ...fields });
  const robot = (label: string, name: string, more: () => Fields = () => ({})) =>
    button(label, name, () => {
      if (store.robot) inject(name, { robot: store.robot.name, ...more() });
    });
  const text = h("input", {
    type: "text",
    maxlength: 200,
    placeholder: "message",
    "aria-label": "message to operators",
    "data-field": "message",
  });
  const send = h("button", { type: "submit", "data-do": "message" }, "Send");
  const form = h("form", { class: "join" }, text, send);
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    if (text.value.trim() && (await inject("message", { text: text.value.trim() })))
      text.value = "";
  });
  const whom = listbox({ "data-field": "victim", "aria-label": "victim that calls" }, []);
  const calls = button("Calls", "victim_calls", () => {
    if (whom.value) inject("victim_calls", { victim: whom.value, ...seconds() });
  });
  store.on("state", () => {
    const names = store.state?.victims ?? [];
    if (names.length === whom.options.length) return;
    whom.replaceChildren(...names.map((name) => h("option", { value: name }, name)));
    calls.disabled = names.length === 0;
  });
  return [
    [
      "Faults",
      [
        robot("Fails", "robot_fails", seconds),
        robot("Recovers", "robot_recovers"),
        robot("Link drops", "link_drops", seconds),
        robot("Link returns", "link_returns"),
      ],
    ],
    ["Victims", [whom, calls]],
    ["For", [lasts, h("span", { class: "quiet" }, "s; 0: for good")]],
    ["Message", [form]],
  ];
}
