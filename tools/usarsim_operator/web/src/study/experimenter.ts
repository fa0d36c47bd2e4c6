// The experimenter's view: who is at what, what happens, and what may be done about it.

import { dialog } from "../dialog";
import { button, h, mark, say } from "../dom";
import { clockText } from "../staleness";
import type { Desk } from "./desk";
import type { Overview } from "./protocol";

const NEEDS = {
  robot_fails: "robot",
  robot_recovers: "robot",
  link_drops: "robot",
  link_returns: "robot",
  victim_calls: "victim",
  message: "text",
} as const;
type Inject = keyof typeof NEEDS;
const WORDS: Record<Inject, string> = {
  robot_fails: "robot fails",
  robot_recovers: "robot recovers",
  link_drops: "link drops",
  link_returns: "link returns",
  victim_calls: "victim calls",
  message: "message",
};

export class Experimenter {
  readonly element: HTMLElement;
  private readonly facts: Record<string, HTMLElement> = {};
  private readonly seats = h("ul", { class: "seats", "data-seats": true });
  private readonly events = h("ol", { class: "events", "data-events": true, tabindex: 0 });
  /** Whom an inject is about: robots or victims of the trial. */
  private readonly whom = h("select", { "data-field": "whom" });
  private known: { robot: string[]; victim: string[] } = { robot: [], victim: [] };
  private needs = "robot";
  private readonly trouble = h("p", { class: "form-note", role: "alert", "data-trouble": true });
  private readonly watch = h(
    "a",
    { "data-do": "watch", target: "_blank", rel: "noreferrer", hidden: true },
    "Watch as instructor",
  );
  private readonly next = button("Next step", "next", () => this.goOn());
  private readonly pass = button("Pass the training", "pass-training", () =>
    this.reason(
      "Pass this training?",
      "The participant goes on as if it had been passed.",
      "Pass it",
      "pass_training",
    ),
  );
  /** What a trial or training must run for. */
  private readonly end = button("End this trial", "end-trial", () =>
    this.reason(
      `End this ${this.what}?`,
      this.what === "trial"
        ? "It ends now and counts as it is. Void it instead if it should be repeated."
        : "It ends now and is passed only if all that it asks for is done. Void it if this attempt should not count.",
      "End it",
      "end_trial",
    ),
  );
  private readonly void = button("Void this trial", "void", () =>
    this.reason(
      `Void this ${this.what}?`,
      "It ends now, does not count, and is repeated.",
      "Void it",
      "void",
    ),
  );
  private readonly leave = button("End the session", "end", () =>
    this.reason(
      "End the session?",
      "The participant withdraws; what is on disk stays.",
      "End it",
      "end_session",
    ),
  );
  private readonly happen = h("button", { type: "submit", "data-do": "inject" }, "Do it");
  private rows = "";
  /** What runs or comes next. */
  private what: "trial" | "training" = "trial";
  /** A form stands before the participant. */
  private asks = false;

  constructor(private readonly desk: Desk) {
    const names = {
      participant: "Participant",
      step: "Now",
      next: "Next",
      trial: "Trial",
      time: "Time in trial",
      score: "Points",
    };
    const facts = Object.entries(names).map(([name, label]) => {
      const value = h("dd", { class: "number", "data-fact": name }, "–");
      this.facts[name] = value;
      return h("div", {}, h("dt", { class: "quiet" }, label), value);
    });
    this.element = h(
      "main",
      { class: "desk" },
      h("h1", { class: "sr" }, "Session"),
      h("section", { class: "card", "aria-label": "now" }, h("dl", { class: "facts" }, ...facts)),
      h("section", { class: "card", "aria-label": "seats" }, h("h2", {}, "Seats"), this.seats),
      h(
        "section",
        { class: "card", "aria-label": "session" },
        h("h2", {}, "Session"),
        this.orders(),
      ),
      h(
        "section",
        { class: "card", "aria-label": "inject" },
        h("h2", {}, "Make happen"),
        this.inject(),
      ),
      h(
        "section",
        { class: "card grow", "aria-label": "events" },
        h("h2", {}, "What has happened"),
        this.events,
      ),
    );
  }

  show(told: Overview): void {
    const { participant, number, step, trial, attempt, time, score, status = "running" } = told;
    this.fact(
      "participant",
      participant === null ? "–" : `${participant}, number ${number ?? "?"}`,
    );
    this.asks = step?.kind === "form";
    this.fact("step", status === "running" ? (told.now ?? step?.kind ?? "–") : ended(told));
    this.fact("next", told.next ?? "–");
    this.pass.hidden = !told.training || status !== "running";
    say(this.next, status === "running" ? "Next step" : "Next participant");
    this.what = told.training ? "training" : "trial";
    say(this.end, `End this ${this.what}`);
    say(this.void, `Void this ${this.what}`);
    for (const one of [this.end, this.void, this.happen])
      one.disabled = status !== "running" || !told.panel;
    this.leave.disabled = status !== "running";
    say(this.trouble, told.trouble ?? "");
    this.watch.hidden = !told.panel;
    if (told.panel && this.watch.href !== told.panel) this.watch.href = told.panel;
    const again = attempt !== null && attempt > 1 ? `, attempt ${attempt}` : "";
    this.fact("trial", trial ? `${trial}${again}` : "–");
    this.fact("time", time === null ? "–" : clockText(time));
    this.fact("score", score === null ? "–" : String(Number(score.toFixed(1))));
    this.seats.replaceChildren(
      ...told.seats.map(({ seat, connected }) =>
        h(
          "li",
          { "data-seat": seat, "data-connected": String(connected) },
          `${connected ? "●" : "✕"} operator ${seat}: ${connected ? "there" : "not there"}`,
        ),
      ),
    );
    const rows = told.events.join("\n");
    if (rows !== this.rows) {
      this.rows = rows;
      this.events.replaceChildren(...told.events.map((row) => h("li", {}, row)));
      this.events.scrollTop = this.events.scrollHeight;
    }
    this.known = { robot: told.robots ?? [], victim: told.victims ?? [] };
    this.offer();
    mark(this.element, "data-running", trial !== null && time !== null);
  }

  private fact(name: string, text: string): void {
    const element = this.facts[name];
    if (element) say(element, text);
  }

  private orders(): HTMLElement {
    return h(
      "div",
      { class: "orders" },
      this.next,
      this.pass,
      this.end,
      this.void,
      this.leave,
      this.watch,
      this.trouble,
    );
  }

  private goOn(): void {
    if (!this.asks) this.desk.order("next");
    else
      dialog(
        "Leave this form?",
        [h("p", { class: "quiet" }, "What is not answered in it is missing.")],
        "Leave it",
        () => this.desk.order("next"),
      );
  }

  /** What cannot be undone is asked for once more, with a reason for the log. */
  private reason(title: string, text: string, accept: string, deed: string): void {
    const why = h("input", { type: "text", maxlength: 200, required: true, "data-field": "why" });
    const body = [h("p", { class: "quiet" }, text), h("label", {}, "Reason", why)];
    dialog(title, body, accept, () => this.desk.order(deed, { reason: why.value.trim() }));
  }

  /** The list of robots or victims, with the choice that stands. */
  private offer(): void {
    const names = this.needs === "victim" ? this.known.victim : this.known.robot;
    const told = names.join("\n");
    if (this.whom.dataset.known === told) return;
    this.whom.dataset.known = told;
    const before = this.whom.value;
    this.whom.replaceChildren(...names.map((value) => h("option", { value }, value)));
    if (names.includes(before)) this.whom.value = before;
  }

  private inject(): HTMLElement {
    const deed = h(
      "select",
      { "data-field": "inject", "aria-label": "what" },
      ...Object.entries(WORDS).map(([value, text]) => h("option", { value }, text)),
    );
    const text = h("input", { type: "text", maxlength: 200, required: true, "data-field": "text" });
    const about = h("label", {}, h("span", {}, "robot"), this.whom);
    const said = h("label", { hidden: true }, "text", text);
    text.disabled = true;
    const lasts = h("input", { type: "number", min: 0.1, step: "any", "data-field": "lasts" });
    deed.addEventListener("change", () => {
      const needs = NEEDS[deed.value as Inject];
      said.hidden = text.disabled = needs !== "text";
      about.hidden = needs === "text";
      this.needs = needs;
      if (about.firstElementChild) say(about.firstElementChild as HTMLElement, needs);
      this.offer();
    });
    const form = h(
      "form",
      { class: "inject" },
      deed,
      about,
      said,
      h("label", {}, h("span", {}, "lasts, s"), lasts),
      this.happen,
    );
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      const kind = deed.value as Inject;
      const about = NEEDS[kind] === "text" ? text.value.trim() : this.whom.value;
      const more = lasts.value === "" ? {} : { lasts: Number(lasts.value) };
      if (about !== "")
        this.desk.order("inject", { inject: { do: kind, [NEEDS[kind]]: about, ...more } });
    });
    return form;
  }
}

/** How the session ended. */
function ended({ status = "", reason }: Overview): string {
  return reason ? `${status}: ${reason}` : status;
}
