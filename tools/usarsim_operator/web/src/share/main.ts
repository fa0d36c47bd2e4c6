// A run in one file: 3D, map, points, driving and events, all at the moment that the time line says.
// Keys: space plays, arrows step 1 s (with shift 10), comma and point a row, plus and minus the speed, digits choose
// a robot.

import { button, forgetColours, h, mark, say } from "../dom";
import { Lanes } from "./lanes";
import { Lists } from "./lists";
import { unpack } from "./packed";
import { Plan } from "./plan";
import { clock, Run } from "./run";
import { Stage } from "./stage";

const SPEEDS = [0.5, 1, 2, 5, 10, 30, 60];
const NORMAL = 2;
const LEGEND =
  "Full lane: an operator drives. Half: by itself. Thin line: an operator has chosen it. " +
  "Diamond: found; red: wrong mark, lost. Bar: touches something.";

class Player {
  time: number;
  private playing = false;
  private speed = NORMAL;
  private robot = 0;
  private last = 0;
  readonly stage: Stage;
  private readonly plan: Plan;
  private readonly lanes: Lanes;
  private readonly lists: Lists;
  private readonly line = h("input", {
    type: "range",
    "aria-label": "time of the trial",
    min: 0,
    max: 0,
    step: 0.1,
  });
  private readonly play = button("Play", "play", () => this.toggle(), "space");
  private readonly fast = h("select", { "aria-label": "speed", title: "plus and minus" });
  private readonly now = h("output", { class: "clock" });
  private readonly points = h("b", { class: "number" });
  private readonly found = h("b", { class: "number" });

  constructor(private readonly run: Run) {
    const seek = (time: number): void => this.seek(time);
    const chosen = (): number => this.robot;
    this.time = run.begin;
    this.stage = new Stage(run, chosen);
    this.plan = new Plan(run, chosen);
    this.lanes = new Lanes(run, seek);
    this.lists = new Lists(run, seek, (robot) => this.choose(robot));
    this.line.min = String(run.begin);
    this.line.max = String(run.end);
    this.line.addEventListener("input", () => this.seek(Number(this.line.value)));
    for (const [i, speed] of SPEEDS.entries())
      this.fast.append(h("option", { value: i, selected: i === this.speed }, `${speed} x`));
    this.fast.addEventListener("change", () => this.pace(Number(this.fast.value)));
    addEventListener("keydown", (event) => this.key(event));
    this.lay();
    this.seek(run.begin);
  }

  private lay(): void {
    const { contents } = this.run;
    const theme = button("Light or dark", "theme", () => {
      const dark = document.documentElement.dataset.theme === "dark";
      paint(dark ? "light" : "dark");
      this.plan.repaint();
      this.lanes.repaint();
      this.stage.draw();
    });
    const ended = `${contents.total.toPrecision(4)} points, ended by ${contents.why}`;
    document.body.prepend(
      h(
        "header",
        {},
        h("h1", {}, contents.title),
        h("span", { class: "quiet" }, [contents.about, ended].filter(Boolean).join(": ")),
        h("span", { class: "spring" }),
        h("span", {}, "Points ", this.points),
        h("span", {}, "Found ", this.found),
        theme,
      ),
      h(
        "main",
        {},
        this.stage.element,
        h("div", { class: "side" }, this.plan.element, this.lists.element),
        h(
          "footer",
          {},
          this.lanes.element,
          h(
            "div",
            { class: "transport" },
            h("div", { class: "line" }, this.line),
            h(
              "div",
              { class: "controls" },
              this.play,
              this.now,
              this.fast,
              h("span", { class: "quiet" }, LEGEND),
            ),
          ),
        ),
      ),
    );
  }

  /** Goes to a time, s since the trial began. */
  seek(time: number): void {
    const { run } = this;
    this.time = Math.max(run.begin, Math.min(run.end, time));
    this.stage.show(this.time);
    this.plan.show(this.time);
    this.lanes.show(this.time);
    this.lists.show(this.time, this.robot);
    const words = `${clock(this.time)} of ${clock(run.end)}`;
    if (Math.abs(Number(this.line.value) - this.time) > 0.05) this.line.value = String(this.time);
    mark(this.line, "aria-valuetext", words);
    say(this.now, words);
    const { victims } = run.contents;
    const found = victims.filter((_, i) => run.finding(i, this.time) !== "missing").length;
    say(this.points, run.score(this.time).toFixed(1));
    say(this.found, `${found} of ${victims.length}`);
  }

  private toggle(): void {
    this.playing = !this.playing;
    if (this.playing && this.time >= this.run.end) this.seek(this.run.begin);
    say(this.play, this.playing ? "Pause" : "Play");
    mark(this.play, "aria-pressed", this.playing);
    this.last = performance.now();
    if (this.playing) requestAnimationFrame(this.tick);
  }

  private readonly tick = (now: number): void => {
    if (!this.playing) return;
    const passed = Math.min(0.5, Math.max(0, now - this.last) / 1000);
    this.last = now;
    this.seek(this.time + passed * (SPEEDS[this.speed] ?? 1));
    if (this.time >= this.run.end) this.toggle();
    else requestAnimationFrame(this.tick);
  };

  private pace(speed: number): void {
    this.speed = Math.max(0, Math.min(SPEEDS.length - 1, speed));
    this.fast.value = String(this.speed);
  }

  private choose(robot: number): void {
    if (robot >= this.run.contents.robots.length) return;
    this.robot = robot;
    this.stage.behind();
    this.seek(this.time);
  }

  private key(event: KeyboardEvent): void {
    const { target } = event;
    if (event.ctrlKey || event.metaKey || event.altKey || target instanceof HTMLSelectElement)
      return;
    const step = event.shiftKey ? 10 : 1;
    const row = this.run.row(this.time);
    const rowAt = (n: number): number => this.run.times[n] ?? this.time;
    const acts: Record<string, () => void> = {
      " ": () => this.toggle(),
      ArrowLeft: () => this.seek(this.time - step),
      ArrowRight: () => this.seek(this.time + step),
      ",": () => this.seek(rowAt(row - 1)),
      ".": () => this.seek(rowAt(row + 1)),
      Home: () => this.seek(this.run.begin),
      End: () => this.seek(this.run.end),
      "+": () => this.pace(this.speed + 1),
      "-": () => this.pace(this.speed - 1),
    };
    const digit = /^[1-9]$/.test(event.key);
    const act = digit ? () => this.choose(Number(event.key) - 1) : acts[event.key];
    // A button that has the focus is pressed by space, as everywhere.
    if (!act || (event.key === " " && target instanceof HTMLButtonElement)) return;
    event.preventDefault();
    act();
  }
}

function paint(theme: "light" | "dark"): void {
  document.documentElement.dataset.theme = theme;
  forgetColours();
}

async function open(): Promise<void> {
  if (matchMedia("(prefers-color-scheme: light)").matches) paint("light");
  const data = document.getElementById("run")?.textContent ?? "";
  const player = new Player(new Run(await unpack(data)));
  // For tests, and for whoever looks under the bonnet.
  Object.assign(window, { share: player });
  mark(document.documentElement, "data-ready", true);
}

open().catch((error: unknown) => {
  const why = `This file cannot be shown: ${String(error)}. It needs a browser of 2023 or later.`;
  document.body.prepend(h("p", { class: "fault", role: "alert" }, why));
});
