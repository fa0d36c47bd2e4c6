// What a seat is shown: one step after the other. The panel of a trial is another page in a frame; while a form freezes
// the trial, or the seat waits, it stays loaded and nothing of it is seen.

import { h, mark, say } from "../dom";
import type { PassedKey } from "../input";
import type { Desk } from "./desk";
import { FormView } from "./form";
import type { EndStep, PanelStep, Step, TextStep } from "./protocol";

export class Stage {
  readonly element = h("main", { class: "stage-study", "data-stage": "wait" });
  private readonly cover = h("div", { class: "cover" });
  private readonly line = h("p", { class: "panel-line", "data-line": true });
  private frame: HTMLIFrameElement | null = null;
  /** What the frame was told to show, without what this page has added to it. */
  private framed = "";
  private form: FormView | null = null;
  private shown: Step | null = null;
  private go: HTMLButtonElement | null = null;

  constructor(private readonly desk: Desk) {
    this.element.append(this.line, this.cover);
    addEventListener("pagehide", () => this.form?.flush());
    addEventListener("focus", () => this.drive());
    // What has filled the screen had the focus: a form that ended that has it now.
    document.addEventListener("fullscreenchange", () => {
      if (!document.fullscreenElement) this.form?.focus();
    });
    // A click beside the panel would take the keys from it.
    this.line.addEventListener("mousedown", (event) => {
      event.preventDefault();
      this.drive();
    });
    for (const way of ["keydown", "keyup"] as const)
      addEventListener(way, (event) => this.pass(event, way === "keydown"), true);
    setInterval(() => this.drive(), 500);
  }

  show(step: Step): void {
    const before = this.shown;
    this.shown = step;
    if (this.form && step.kind === "form" && before?.kind === "form" && same(before, step)) {
      this.form.again(step);
      return;
    }
    if (before && step.kind !== "form" && JSON.stringify(before) === JSON.stringify(step)) {
      if (this.go) this.go.disabled = false;
      return;
    }
    this.form?.flush();
    this.form = null;
    this.go = null;
    const freeze = step.kind === "form" && step.freeze === true;
    if (step.kind !== "panel" && step.kind !== "wait" && !freeze) this.unload();
    mark(this.element, "data-stage", step.kind);
    mark(this.element, "data-freeze", freeze);
    this.line.hidden = step.kind !== "panel";
    this.cover.hidden = step.kind === "panel";
    if (step.kind !== "panel") this.hidePanel();
    switch (step.kind) {
      case "panel":
        this.cover.replaceChildren();
        this.panel(step);
        break;
      case "form":
        this.form = new FormView(step, this.desk);
        this.cover.replaceChildren(this.form.element);
        this.form.focus();
        break;
      case "wait":
        this.cover.replaceChildren(h("p", { class: "wait", role: "status" }, step.text));
        break;
      default:
        this.cover.replaceChildren(this.text(step));
        this.cover.querySelector("h1")?.focus();
    }
    this.cover.scrollTop = 0;
  }

  refused(why: string, missing: string[]): void {
    if (this.go) this.go.disabled = false;
    this.form?.refused(why, missing);
  }

  private text(step: TextStep | EndStep): HTMLElement {
    const paragraphs = step.text.split(/\n\s*\n/).filter((one) => one.trim() !== "");
    const label = step.kind === "text" ? step.button : null;
    const sheet = h(
      "article",
      { class: "sheet", "data-text": step.kind },
      h("h1", { tabindex: -1 }, step.title),
      ...paragraphs.map((one) => h("p", {}, one.trim())),
    );
    if (label !== null) {
      const go = h("button", { type: "button", class: "primary", "data-do": "next" }, label);
      go.addEventListener("click", () => {
        go.disabled = this.desk.say("next");
      });
      this.go = go;
      sheet.append(h("div", { class: "form-foot" }, h("div", { class: "spring" }), go));
    }
    return sheet;
  }

  private panel(step: PanelStep): void {
    say(this.line, step.line);
    const url = new URL(step.url, location.href);
    if (url.protocol !== "http:" && url.protocol !== "https:") return;
    if (this.frame === null || this.framed !== step.url) {
      this.unload();
      this.framed = step.url;
      url.hash += `&theme=${document.documentElement.dataset.theme ?? "dark"}`;
      const frame = h("iframe", { title: "console", allow: "gamepad; fullscreen" });
      frame.addEventListener("load", () => this.drive());
      frame.src = url.href;
      this.frame = frame;
      this.element.append(frame);
    }
    mark(this.frame, "data-hidden", false);
    this.frame.inert = false;
    this.drive();
  }

  /** Keys and pad go to the panel while it is shown, unless something else here was chosen. */
  private drive(): void {
    const { frame } = this;
    if (!frame || this.shown?.kind !== "panel" || document.querySelector("dialog[open]")) return;
    const { activeElement } = document;
    if (activeElement !== document.body && activeElement !== null) return;
    frame.focus();
    frame.contentWindow?.focus();
  }

  /** Keys that are pressed beside the panel are told to it: the emergency stop works there, too. */
  private pass(event: KeyboardEvent, down: boolean): void {
    const { frame } = this;
    if (!frame?.contentWindow || this.shown?.kind !== "panel") return;
    const { code, key, repeat } = event;
    if (key === " ") event.preventDefault(); // it would press the button that has the focus
    const told: PassedKey = { type: "usarsim-key", code, key, down, repeat };
    frame.contentWindow.postMessage(told, new URL(frame.src).origin);
  }

  /** Nothing of the panel is seen, not even where it fills the screen; it stays as it is. */
  private hidePanel(): void {
    if (document.fullscreenElement) void document.exitFullscreen();
    if (!this.frame) return;
    this.frame.blur();
    this.frame.inert = true;
    mark(this.frame, "data-hidden", true);
  }

  private unload(): void {
    this.frame?.remove();
    this.frame = null;
  }
}

function same(one: Step, other: Step): boolean {
  if (one.kind !== "form" || other.kind !== "form" || one.session !== other.session) return false;
  return one.step === other.step && one.form.form === other.form.form;
}
