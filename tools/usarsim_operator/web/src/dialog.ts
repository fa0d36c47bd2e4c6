// A dialog with a form. It lies below the header, and all but the emergency stop waits behind it: the browser's own modal
// dialogs would take that button's clicks, too.

import { button, h } from "./dom";

/** What is open, the last one on top, each with what had the focus before. */
const open: { element: HTMLDialogElement; veil: HTMLElement; before: Element | null }[] = [];

/** Makes everything but the topmost dialog and the emergency stop inert. */
function isolate(): void {
  const top = open.at(-1)?.veil;
  const stop = document.querySelector(".estop");
  const visit = (element: Element): void => {
    for (const child of element.children) {
      if (child === stop || !(child instanceof HTMLElement)) continue;
      if (child.contains(stop)) visit(child);
      else child.inert = top !== undefined && child !== top;
    }
  };
  visit(document.body);
}

/** Keeps the dialogs below the header, however high that is. */
export function belowHeader(header: HTMLElement): void {
  new ResizeObserver(() => {
    const { bottom } = header.getBoundingClientRect();
    document.documentElement.style.setProperty("--head", `${Math.ceil(bottom)}px`);
  }).observe(header);
}

/** Opens a dialog; Esc and `decline` leave it, the focus then goes back to where it was. */
export function dialog(
  title: string,
  body: Node[],
  accept: string,
  accepted: () => void,
  decline = "Cancel",
  declined: () => void = () => {},
): HTMLDialogElement {
  const no = button(decline, "cancel", () => element.close("no"));
  const yes = h("button", { type: "submit", class: "primary", "data-do": "accept" }, accept);
  const form = h(
    "form",
    { method: "dialog" },
    h("h2", {}, title),
    ...body,
    h("div", { class: "dialog-foot" }, no, yes),
  );
  const element = h("dialog", { "data-dialog": true, "aria-label": title }, form);
  const veil = h("div", { class: "veil" }, element);
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    element.close("yes");
  });
  element.addEventListener("keydown", (event) => {
    // Keys that an input method or a list of proposals takes are not the dialog's.
    if (event.key === "Escape" && !event.defaultPrevented && !event.isComposing)
      element.close("no");
  });
  // In a list Enter would open it; everywhere else in a form it accepts.
  form.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" || event.isComposing || !(event.target instanceof HTMLSelectElement))
      return;
    event.preventDefault();
    form.requestSubmit(yes);
  });
  element.addEventListener("close", () => {
    const place = open.findIndex((one) => one.element === element);
    const [gone] = place < 0 ? [] : open.splice(place, 1);
    isolate();
    veil.remove();
    if (gone?.before instanceof HTMLElement && gone.before.isConnected) gone.before.focus();
    if (element.returnValue === "yes") accepted();
    else declined();
  });
  open.push({ element, veil, before: document.activeElement });
  document.body.append(veil);
  isolate();
  element.show();
  return element;
}

/** Esc while the focus is on nothing, or on the emergency stop: the topmost dialog is left all the same. */
globalThis.addEventListener?.("keydown", (event) => {
  const top = open.at(-1)?.element;
  if (event.key !== "Escape" || event.defaultPrevented || !top) return;
  if (!(event.target instanceof Node && top.contains(event.target))) top.close("no");
});
