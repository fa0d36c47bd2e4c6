// One question of a form as what answers it. Every answer is a native radio, text or number field, so that keys and
// screen readers know it; labels carry `data-value`, questions `data-item` and `data-missing`.

import { h, mark, say } from "../dom";
import type { Item, Value } from "./protocol";
import { valuesOf } from "./protocol";

/** Values up to which a scale is a row of numbered buttons; ticks above, and a number field beyond those. */
const MOST_BUTTONS = 11;
const MOST_TICKS = 41;
/** ms without a key after which a text is sent. */
const TYPED_MS = 300;
/** Characters of a text (usarsim_study.forms.LONGEST_TEXT). */
const LONGEST_TEXT = 4000;

export interface Field {
  element: HTMLElement;
  /** Points at a missing answer, or no longer. */
  point: (missing: boolean) => void;
  focus: () => void;
  /** Sends what is typed and not sent yet. */
  flush: () => void;
  /** Why what is typed is no answer; empty: it is one, or nothing is typed. */
  fault: () => string;
  /** Shows an answer that came from elsewhere. */
  show: (value: Value | undefined) => void;
}

export type Changed = (value: Value | null) => void;

interface Control {
  element: HTMLElement;
  inputs: HTMLElement[];
  show: (value: Value | undefined) => void;
  flush?: () => void;
  fault?: () => string;
}

export function field(id: string, item: Item, first: Value | undefined, changed: Changed): Field {
  const question = h("div", { class: "question-text", id: `${id}-text` }, ...worded(item.text));
  const fault = h("p", { class: "missing-note", id: `${id}-fault`, hidden: true });
  const element = h("section", { class: "item", "data-item": item.name, "data-kind": item.kind });
  const point = (missing: boolean): void => {
    mark(element, "data-missing", missing);
    // Once shown it keeps its line: what stands below must not jump from under the next click.
    fault.hidden &&= !missing;
    say(fault, missing ? control.fault?.() || "Please answer this." : "\u00a0");
    for (const input of control.inputs) mark(input, "aria-invalid", missing ? "true" : null);
  };
  const told = (value: Value | null): void => {
    mark(element, "data-answered", value !== null);
    clear.hidden = item.required || value === null;
    if (value !== null) point(false);
    changed(value);
  };
  const control = controlOf(id, item, told);
  // A question that may be left open can be opened again.
  const clear = h("button", { type: "button", class: "clear", "data-do": "clear" }, "Clear");
  clear.setAttribute("aria-label", `Clear: ${item.text}`);
  clear.addEventListener("click", () => {
    control.show(undefined);
    told(null);
    control.inputs[0]?.focus();
  });
  const optional = item.required ? null : h("span", { class: "quiet optional" }, "optional");
  const show = (value: Value | undefined): void => {
    control.show(value);
    mark(element, "data-answered", value !== undefined);
    clear.hidden = item.required || value === undefined;
  };
  element.append(
    h("div", { class: "question-head" }, question, ...(optional ? [optional] : []), clear),
    control.element,
    fault,
  );
  show(first);
  return {
    element,
    point,
    show,
    flush: () => control.flush?.(),
    fault: () => control.fault?.() ?? "",
    focus: () => {
      const chosen = control.inputs.find((one) => one.matches(":checked"));
      (chosen ?? control.inputs[0])?.focus();
    },
  };
}

/** "Effort: How hard ...?" with its first word as a name. */
function worded(text: string): (Node | string)[] {
  const [name = "", ...rest] = text.split(": ");
  if (rest.length === 0 || name.length > 24) return [text];
  return [h("strong", {}, name), ` ${rest.join(": ")}`];
}

function controlOf(id: string, item: Item, told: Changed): Control {
  switch (item.kind) {
    case "scale":
      return scale(id, item, told);
    case "choice": {
      const options = (item.choices ?? []).map(({ name, text }) => ({ value: name, text }));
      return radios(id, options, "choices", told);
    }
    case "flag":
      return radios(
        id,
        [
          { value: true, text: "Yes" },
          { value: false, text: "No" },
        ],
        "choices flag",
        told,
      );
    case "text":
      return typed(id, item, told);
  }
}

interface Option {
  value: Value;
  text: string;
  /** What is said of it where the text says nothing. */
  label?: string;
  /** How it looks among others. */
  look?: string;
}

function radios(id: string, options: Option[], look: string, told: Changed): Control {
  const inputs = options.map(({ value, label }, place) => {
    const input = h("input", { type: "radio", name: id, id: `${id}-${place}`, value: place });
    if (label !== undefined) input.setAttribute("aria-label", label);
    input.setAttribute("aria-describedby", `${id}-fault`);
    input.addEventListener("change", () => told(value));
    return input;
  });
  const element = h(
    "div",
    { class: look, role: "radiogroup", "aria-labelledby": `${id}-text` },
    ...options.map(({ value, text, look: how }, place) => {
      const data = { "data-value": String(value), class: how ?? "option" };
      return h("label", data, inputs[place] ?? null, h("span", {}, text));
    }),
  );
  const show = (value: Value | undefined): void => {
    options.forEach((option, place) => {
      const input = inputs[place];
      if (input) input.checked = option.value === value;
    });
  };
  return { element, inputs, show };
}

function scale(id: string, item: Item, told: Changed): Control {
  const values = valuesOf(item);
  if (values.length > MOST_TICKS) return number(id, item, told);
  const few = values.length <= MOST_BUTTONS;
  const [low, high] = [values[0] ?? 0, values.at(-1) ?? 0];
  const middle = (low + high) / 2;
  const ends = (value: number): string =>
    value === low && item.left
      ? `, ${item.left}`
      : value === high && item.right
        ? `, ${item.right}`
        : "";
  const options = values.map((value) => ({
    value,
    text: few ? String(value) : "",
    label: `${value}${ends(value)}`,
    look: few ? "step" : value === low || value === middle || value === high ? "tick long" : "tick",
  }));
  const control = radios(id, options, few ? "steps" : "ticks", told);
  if (!few) drawn(control.element);
  const words = h(
    "div",
    { class: "ends", "aria-hidden": "true" },
    h("span", {}, item.left ?? ""),
    h("span", {}, item.right ?? ""),
  );
  const element = h("div", { class: few ? "scale few" : "scale many" }, control.element, words);
  return { ...control, element };
}

/** Ticks are narrow: a finger or a pointer that is down chooses the one that it is above. */
function drawn(ticks: HTMLElement): void {
  const choose = (event: PointerEvent): void => {
    const box = ticks.getBoundingClientRect();
    const count = ticks.children.length;
    const place = Math.floor((count * (event.clientX - box.left)) / box.width);
    const label = ticks.children[Math.min(count - 1, Math.max(0, place))];
    const input = label?.querySelector("input");
    if (input && !input.checked) input.click();
  };
  ticks.addEventListener("pointerdown", (event) => {
    ticks.setPointerCapture(event.pointerId);
    choose(event);
  });
  ticks.addEventListener("pointermove", (event) => {
    if (ticks.hasPointerCapture(event.pointerId)) choose(event);
  });
}

function number(id: string, item: Item, told: Changed): Control {
  const { low = 0, high = 100, step = 1 } = item;
  const input = h("input", { type: "number", min: low, max: high, step });
  input.setAttribute("aria-labelledby", `${id}-text`);
  input.setAttribute("aria-describedby", `${id}-fault`);
  input.addEventListener("change", () => {
    told(input.value === "" || !input.checkValidity() ? null : Number(input.value));
  });
  const fault = (): string => {
    if (input.checkValidity()) return "";
    return `Please give a number from ${low} to ${high}${step === 1 ? "" : ` in steps of ${step}`}.`;
  };
  const range = `${low}${item.left ? ` (${item.left})` : ""} to ${high}${item.right ? ` (${item.right})` : ""}`;
  const element = h("div", { class: "number-field" }, input, h("span", { class: "quiet" }, range));
  const show = (value: Value | undefined): void => {
    input.value = value === undefined ? "" : String(value);
  };
  return { element, inputs: [input], show, fault };
}

function typed(id: string, item: Item, told: Changed): Control {
  const input = h("textarea", { rows: 3, maxlength: LONGEST_TEXT });
  input.setAttribute("aria-labelledby", `${id}-text`);
  input.setAttribute("aria-describedby", `${id}-fault`);
  let timer = 0;
  let sent = "";
  const flush = (): void => {
    clearTimeout(timer);
    if (input.value === sent) return;
    sent = input.value;
    const blank = item.required ? sent.trim() === "" : sent === "";
    told(blank ? null : sent);
  };
  input.addEventListener("input", () => {
    clearTimeout(timer);
    timer = window.setTimeout(flush, TYPED_MS);
  });
  input.addEventListener("change", flush);
  const show = (value: Value | undefined): void => {
    if (document.activeElement === input && input.value !== "") return;
    input.value = sent = value === undefined ? "" : String(value);
  };
  return { element: input, inputs: [input], show, flush };
}
