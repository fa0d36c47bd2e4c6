// A choice from a list that opens within the page. The browser's own lists take every key while they are open, those of
// the emergency stop too.

import { h } from "./dom";
import { pageTime } from "./store";

/** Rows that an open list shows at most. */
const MOST_ROWS = 8;
/** s for which a choice stands before what is so in truth is shown again. */
const STANDS_S = 1;

/** When each list was changed by hand, page time. */
const changes = new WeakMap<HTMLSelectElement, number>();

/** Shows what is so, unless somebody is about to choose. */
export function follow(select: HTMLSelectElement, value: string): void {
  const chosen = changes.get(select) ?? Number.NEGATIVE_INFINITY;
  if (select.size <= 1 && pageTime() - chosen > STANDS_S) select.value = value;
}

type Attributes = Parameters<typeof h>[1];

/** A select of options, each a value and its text; arrows choose, Enter and a click open and close it. */
export function listbox(
  attributes: Attributes,
  options: [value: string, text: string][],
): HTMLSelectElement {
  const select = h(
    "select",
    attributes,
    ...options.map(([value, text]) => h("option", { value }, text)),
  );
  // What stays in its place while the list lies over what is below.
  const open = (): boolean => select.size > 1;
  const show = (wanted: boolean): void => {
    if (wanted === open()) return;
    select.size = wanted ? Math.max(2, Math.min(MOST_ROWS, select.options.length)) : 0;
  };
  let before = select.value;
  const told = (): void => {
    if (select.value === before) return;
    before = select.value;
    select.dispatchEvent(new Event("change", { bubbles: true }));
  };
  let touched = false;
  select.addEventListener("pointerdown", (event) => {
    touched = event.pointerType === "touch";
  });
  select.addEventListener("mousedown", (event) => {
    // A finger gets the list of the device: there are no keys that it could take.
    if (touched || open()) return;
    event.preventDefault();
    select.focus();
    show(true);
  });
  select.addEventListener("click", (event) => {
    if (open() && event.target instanceof HTMLOptionElement) show(false);
  });
  select.addEventListener("change", () => {
    before = select.value;
    changes.set(select, pageTime());
  });
  select.addEventListener("focus", () => {
    before = select.value;
  });
  select.addEventListener("blur", () => show(false));
  select.addEventListener("keydown", (event) => {
    const { key } = event;
    if (key === "Escape" && open()) {
      event.preventDefault(); // the list takes it, and not the dialog that it may stand in
      show(false);
    } else if (key === "Enter" || key === "F4" || (event.altKey && key.startsWith("Arrow"))) {
      event.preventDefault();
      show(!open());
    } else if (!open() && (key === "ArrowDown" || key === "ArrowUp")) {
      event.preventDefault();
      const next = select.selectedIndex + (key === "ArrowDown" ? 1 : -1);
      if (next < 0 || next >= select.options.length) return;
      select.selectedIndex = next;
      told();
    }
  });
  return select;
}
