// What stands beside the pictures: robots and how they are driven, victims, events. A click on a time goes there.

import { button, choice, h, mark, panel, say } from "../dom";
import { markIcon } from "../looks";
import { before, clock, type Run, SOURCES } from "./run";

type Tab = "now" | "victims" | "events" | "about";

/** Events that a choice shows. */
const SHOWN = {
  all: () => true,
  verdicts: (kind: string) => /found|credit|duplicate|wrong|lost|collision|zone|trial/.test(kind),
  operators: (kind: string) => /input|connect|mark|estop|acknowledge|enable|mode|probe/.test(kind),
} as const;
const FINDINGS = { missing: "not found", found: "found", credited: "credited" } as const;

interface RobotRow {
  mode: HTMLElement;
  told: HTMLElement;
  bars: [HTMLElement, HTMLElement];
  row: HTMLElement;
}

export class Lists {
  readonly element: HTMLElement;
  private readonly bodies: Record<Tab, HTMLElement>;
  private readonly robots: RobotRow[] = [];
  private readonly victims: { state: HTMLElement; row: HTMLElement }[] = [];
  private events: { time: number; row: HTMLElement }[] = [];
  private readonly eventList = h("ol", { class: "events" });
  private newest = -2;
  private shown: [number, number] = [0, 0];

  constructor(
    private readonly run: Run,
    private readonly seek: (time: number) => void,
    choose: (robot: number) => void,
  ) {
    this.bodies = {
      now: this.now(choose),
      victims: this.people(),
      events: this.happened(),
      about: h("ul", { class: "about" }, ...run.contents.notes.map((one) => h("li", {}, one))),
    };
    const names = { now: "Robots", victims: "Victims", events: "Events", about: "About" };
    const tabs = choice("lists", names, "now", (tab) => this.open(tab));
    this.element = panel("lists", "Details", [tabs], ...Object.values(this.bodies));
    this.open("now");
  }

  private open(tab: Tab): void {
    for (const [name, body] of Object.entries(this.bodies)) body.hidden = name !== tab;
    this.newest = -2;
    this.show(...this.shown);
  }

  private now(choose: (robot: number) => void): HTMLElement {
    const rows = this.run.contents.robots.map(({ name, class: kind }, number) => {
      const bar = (): HTMLElement => h("span", { class: "fill" });
      const one: RobotRow = {
        mode: h("span", { class: "mode" }),
        told: h("code", {}),
        bars: [bar(), bar()],
        row: h("li", { "data-robot": name }),
      };
      const pick = button("", `robot-${number}`, () => choose(number), `${kind}: follow it`);
      pick.append(markIcon(number), name);
      const wheels = h(
        "span",
        { class: "wheels", title: "left and right wheels" },
        ...one.bars.map((fill) => h("span", { class: "bar" }, fill)),
      );
      one.row.append(pick, one.mode, wheels, one.told);
      this.robots.push(one);
      return one.row;
    });
    return h("ul", { class: "robots" }, ...rows);
  }

  private people(): HTMLElement {
    const { victims, began } = this.run.contents;
    const rows = victims.map((victim) => {
      const state = h("span", { class: "state" });
      const row = h("li", { "data-victim": victim.name }, h("b", {}, victim.name), state);
      if (victim.found !== null) {
        const time = victim.found - began;
        row.append(button(clock(time), "seek", () => this.seek(time), "go there"));
      }
      const words = [victim.robot && `by ${victim.robot}`, victim.why].filter(Boolean).join(", ");
      row.append(h("span", { class: "quiet" }, words));
      this.victims.push({ state, row });
      return row;
    });
    return h("ul", { class: "victims" }, ...rows);
  }

  private happened(): HTMLElement {
    const names = { all: "All", verdicts: "Verdicts", operators: "Operators" };
    const which = choice("which events", names, "all", (kind) => {
      this.fill(kind);
      this.show(...this.shown);
    });
    this.fill("all");
    return h("div", { class: "happened" }, which, this.eventList);
  }

  private fill(which: keyof typeof SHOWN): void {
    const { events, began } = this.run.contents;
    this.events = events
      .filter(([, kind]) => SHOWN[which](kind))
      .map(([at, kind, , words]) => {
        const time = at - began;
        const when = button(clock(time), "seek", () => this.seek(time), "go there");
        return { time, row: h("li", { "data-kind": kind }, when, h("span", {}, words)) };
      });
    this.eventList.replaceChildren(...this.events.map(({ row }) => row));
    this.newest = -2;
  }

  show(time: number, chosen: number): void {
    this.shown = [time, chosen];
    const { run } = this;
    const looked = [...run.chosen(time)];
    this.robots.forEach((one, number) => {
      const name = run.contents.robots[number]?.name ?? "";
      const { left, right, source } = run.power(number, time);
      const told = run.told(number, time);
      const there = run.pose(number, time) !== null;
      const seats = looked.filter(([, robot]) => robot === name).map(([page]) => page);
      const eyes = seats.length > 0 ? `, chosen by ${seats.join(", ")}` : "";
      const by = SOURCES[source] && (left !== 0 || right !== 0) ? `, ${SOURCES[source]}` : "";
      say(one.mode, there ? `${run.mode(number, time) || "stopped"}${by}${eyes}` : "not there");
      say(one.told, told);
      [left, right].forEach((value, i) => {
        const fill = one.bars[i];
        if (!fill) return;
        fill.style.width = `${Math.min(50, 50 * Math.abs(value))}%`;
        fill.style.left = value < 0 ? `${50 - Math.min(50, 50 * Math.abs(value))}%` : "50%";
      });
      mark(one.row, "data-chosen", number === chosen);
    });
    this.victims.forEach(({ state, row }, number) => {
      const finding = run.finding(number, time);
      say(state, FINDINGS[finding]);
      mark(row, "data-finding", finding);
    });
    const newest = before(this.events.length, time, (i) => this.events[i]?.time ?? 0);
    if (newest === this.newest) return;
    this.newest = newest;
    for (const [i, { row }] of this.events.entries()) mark(row, "data-past", i <= newest);
    const row = this.events[newest]?.row;
    if (row && !this.bodies.events.hidden)
      this.eventList.scrollTop = row.offsetTop - this.eventList.offsetTop - 60;
  }
}
