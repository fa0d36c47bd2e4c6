// A form, page by page. What is asked and not answered holds up the next page, and is pointed at.

import { button, h, say } from "../dom";
import type { Desk } from "./desk";
import { type Field, field } from "./items";
import { type FormStep, type Item, missing, type Value } from "./protocol";

export class FormView {
  readonly element: HTMLElement;
  private readonly heading: HTMLElement;
  private readonly body = h("div", { class: "items" });
  private readonly note = h("p", { class: "form-note", role: "alert", "data-note": true });
  private readonly next = h("button", { type: "submit", class: "primary", "data-do": "next" });
  private readonly back: HTMLButtonElement;
  private readonly count = h("span", { class: "quiet", "data-page": true });
  private fields = new Map<string, Field>();
  private given: Record<string, Value>;
  private page: number;

  constructor(
    private step: FormStep,
    private readonly desk: Desk,
  ) {
    const { form } = step;
    this.given = { ...step.answers };
    this.page = Math.min(Math.max(1, step.page), form.pages.length);
    this.heading = h("h1", { tabindex: -1 }, form.title || "Questions");
    this.back = button("Back", "back", () => this.turn(this.page - 1));
    const foot = h(
      "div",
      { class: "form-foot" },
      this.count,
      h("div", { class: "spring" }),
      this.back,
      this.next,
    );
    const inner = h("form", { novalidate: true }, this.body, this.note, foot);
    inner.addEventListener("submit", (event) => {
      event.preventDefault();
      this.forward();
    });
    this.element = h(
      "article",
      { class: "sheet form", "data-form": form.form, "data-kind": form.kind },
      this.heading,
      inner,
    );
    this.draw();
  }

  focus(): void {
    this.heading.focus();
  }

  /** The same form again, over a new connection. */
  again(step: FormStep): void {
    this.step = step;
    this.given = { ...step.answers };
    for (const [name, one] of this.fields) one.show(this.given[name]);
    this.next.disabled = false;
  }

  /** Sends what is typed and not sent yet. */
  flush(): void {
    for (const one of this.fields.values()) one.flush();
  }

  /** The desk did not take the form, or a page of it. */
  refused(why: string, names: string[]): void {
    this.next.disabled = false;
    const pages = this.step.form.pages;
    const first = pages.findIndex((page) => page.some((one) => names.includes(one.name)));
    if (first >= 0 && first + 1 !== this.page) {
      this.page = first + 1;
      this.draw();
    }
    if (names.length > 0) this.point(names);
    else say(this.note, why);
  }

  private get items(): Item[] {
    return this.step.form.pages[this.page - 1] ?? [];
  }

  private draw(): void {
    const { form } = this.step;
    const last = this.page === form.pages.length;
    const pairs = isPairs(this.items);
    this.fields = new Map(
      this.items.map((item) => {
        const id = `${form.form}-${item.name}`;
        const one = field(id, item, this.given[item.name], (value) => this.changed(item, value));
        return [item.name, one];
      }),
    );
    const intro = pairs ? (this.items[0]?.text ?? "") : this.page === 1 ? form.instructions : "";
    this.body.replaceChildren(
      ...(intro === "" ? [] : [h("p", { class: "intro" }, intro)]),
      h(
        "div",
        { class: pairs ? "list pairs" : "list" },
        ...[...this.fields.values()].map((one) => one.element),
      ),
    );
    say(this.note, "");
    say(this.count, form.pages.length > 1 ? `Page ${this.page} of ${form.pages.length}` : "");
    say(this.next, last ? "Done" : "Next");
    this.back.hidden = this.page === 1;
  }

  private changed(item: Item, value: Value | null): void {
    if (value === null) delete this.given[item.name];
    else this.given[item.name] = value;
    this.desk.answer(item.name, value);
    if (this.note.textContent !== "" && this.missing.length === 0) say(this.note, "");
  }

  private get missing(): string[] {
    const names = new Set(missing(this.items, this.given));
    for (const [name, one] of this.fields) if (one.fault() !== "") names.add(name);
    return [...names];
  }

  private forward(): void {
    this.flush();
    if (this.missing.length > 0) this.point(this.missing);
    else if (this.page < this.step.form.pages.length) this.turn(this.page + 1);
    else if (this.desk.say("hand_in")) this.next.disabled = true;
    else say(this.note, "The desk does not answer. Your answers are kept here: try again soon.");
  }

  private turn(page: number): void {
    this.flush();
    this.page = page;
    this.draw();
    this.desk.say("turn", { page });
    this.element.parentElement?.scrollTo(0, 0);
    this.focus();
  }

  /** Names what is missing, and goes to the first of it. */
  private point(names: string[]): void {
    for (const [name, one] of this.fields) one.point(names.includes(name));
    const here = names.filter((name) => this.fields.has(name));
    say(
      this.note,
      here.length === 1 ? "One answer is missing." : `${here.length} answers are missing.`,
    );
    const first = this.fields.get(here[0] ?? "");
    first?.element.scrollIntoView({ block: "center" });
    first?.focus();
  }
}

/** A page that asks one question of many pairs: it is asked once, above them. */
function isPairs(items: Item[]): boolean {
  const [first] = items;
  return (
    items.length > 3 && items.every((one) => one.text === first?.text && one.choices?.length === 2)
  );
}
