// The page of `usarsim explore show --browser` and `run --show`: any step of a run, also while it goes on.

import { button, h, mark, say } from "../dom";
import { Chart } from "./chart";
import { ask, type Figure, type Progress, picture, played, type Run, SPEEDS } from "./run";

const POLL_MS = 400;
const TICK_MS = 30;

class Player {
  step = 0;
  last = 0;
  /** Shows the newest step, and the next one when it comes. */
  follows = true;
  private from = 0;
  private since = 0;
  private speed = SPEEDS[5] ?? 15;
  plays = false;

  constructor(private readonly moved: () => void) {}

  seek(step: number): void {
    this.plays = this.follows = false;
    this.go(step);
  }

  play(plays: boolean): void {
    this.follows = false;
    this.plays = plays;
    if (plays && this.step === this.last) this.step = 0;
    this.begin();
    this.moved();
  }

  setSpeed(speed: number): void {
    this.speed = speed;
    this.begin();
  }

  newest(): void {
    this.plays = false;
    this.follows = true;
    this.go(this.last);
  }

  grown(last: number): void {
    this.last = last;
    if (this.follows) this.go(last);
  }

  tick(): void {
    if (!this.plays) return;
    this.go(played(this.from, performance.now() - this.since, this.speed, this.last));
  }

  private begin(): void {
    this.from = this.step;
    this.since = performance.now();
  }

  private go(step: number): void {
    const before = this.step;
    this.step = Math.max(0, Math.min(this.last, Math.round(step)));
    if (this.step !== before || !this.plays) this.moved();
  }
}

async function main(): Promise<void> {
  const run = await ask<Run>("run");
  const shares: number[][] = [];
  const player = new Player(() => show());
  const image = h("img", { alt: "the map of the run", "data-step": "" });
  const chart = new Chart(run.names.length - 1);
  const labels = {
    step: h("output"),
    team: h("output"),
    base: h("output"),
    end: h("span", { class: "quiet" }),
  };
  const slider = h("input", {
    type: "range",
    name: "step",
    min: 0,
    max: 0,
    "aria-label": "step",
    oninput: () => player.seek(slider.valueAsNumber),
  });
  const rate = h("output");
  const speed = h("input", {
    type: "range",
    name: "speed",
    min: 0,
    max: SPEEDS.length - 1,
    value: 5,
    "aria-label": "speed",
    oninput: () => {
      player.setSpeed(SPEEDS[speed.valueAsNumber] ?? 0);
      say(rate, `${SPEEDS[speed.valueAsNumber] ?? 0} steps/s`);
    },
  });
  say(rate, "15 steps/s");
  const plays = button("Play", "play", () => player.play(!player.plays));
  const newest = button(
    "Newest",
    "newest",
    () => player.newest(),
    "the last step, and those to come",
  );
  const robot = h(
    "select",
    { "aria-label": "whose map", onchange: () => show() },
    h("option", { value: "" }, "the team"),
    ...run.names.map((name) => h("option", { value: name }, name)),
  );
  const boxes = run.overlays.map((one) =>
    h("input", { type: "checkbox", name: one.name, checked: one.default, onchange: () => show() }),
  );
  const overlays = run.overlays.map((one, i) =>
    h("label", { title: one.help }, boxes[i] ?? null, one.name),
  );
  const rows = h("tbody");

  /** One picture at a time is asked for; then that which is wanted by now. */
  let asked = "";
  const load = (): void => {
    const names = boxes.filter((box) => box.checked).map((box) => box.name);
    const wanted = picture(player.step, names, robot.value);
    if (wanted === image.getAttribute("src") || asked !== "") return;
    asked = wanted;
    const step = player.step;
    image.src = wanted;
    void ask<Figure[]>(`figures?step=${step}`).then((figures) => {
      rows.replaceChildren(
        ...figures.map((one, i) => row(one, shares[step]?.[i === 0 ? 1 : i + 1])),
      );
    }, broken);
  };
  const done = (): void => {
    asked = "";
    mark(image, "data-step", new URLSearchParams(image.src.split("?")[1]).get("step"));
    load();
  };
  image.addEventListener("load", done);
  image.addEventListener("error", done);

  function show(): void {
    const { step, last } = player;
    const [team, base] = shares[step] ?? [];
    slider.max = String(last);
    slider.valueAsNumber = step;
    say(labels.step, `step ${step} of ${last}`);
    say(labels.team, `team ${(team ?? 0).toFixed(1)} %`);
    say(labels.base, `base ${(base ?? 0).toFixed(1)} %`);
    say(plays, player.plays ? "Pause" : "Play");
    mark(newest, "aria-pressed", player.follows);
    chart.point(step, last);
    load();
  }

  function broken(error: Error): void {
    say(labels.end, `the server does not answer: ${error.message}`);
    labels.end.className = "fault";
  }

  async function poll(): Promise<void> {
    const news = await ask<Progress>(`progress?since=${shares.length}`);
    shares.push(...news.shares);
    chart.fill(shares);
    player.grown(shares.length - 1);
    show();
    say(labels.end, news.ended === null ? "running" : `ended: ${news.ended}`);
    if (news.ended === null) setTimeout(() => poll().catch(broken), POLL_MS);
  }

  document.body.append(
    h(
      "header",
      {},
      h("h1", {}, run.title),
      h("span", { class: "spring" }),
      h("span", { class: "number" }, labels.step),
      h("span", { class: "number of-team" }, labels.team),
      h("span", { class: "number of-base" }, labels.base),
      labels.end,
    ),
    h(
      "main",
      {},
      h("section", { class: "stage", "aria-label": "map" }, image),
      h(
        "aside",
        {},
        h("section", { class: "panel" }, h("h2", {}, "Map and plans of"), robot),
        h(
          "section",
          { class: "panel" },
          h("h2", {}, "Overlays"),
          h("div", { class: "overlays" }, ...overlays),
        ),
        h("section", { class: "panel" }, h("h2", {}, "Percent known by step"), chart.svg),
        h("section", { class: "panel" }, h("h2", {}, "Robots"), table(rows)),
      ),
    ),
    h(
      "footer",
      {},
      button("Restart", "restart", () => player.seek(0)),
      button("-1", "back", () => player.seek(player.step - 1), "a step back"),
      plays,
      button("+1", "forward", () => player.seek(player.step + 1), "a step forward"),
      slider,
      newest,
      speed,
      rate,
    ),
  );
  document.addEventListener("keydown", (event) => {
    if (event.target instanceof HTMLInputElement && event.target.type === "range") return;
    const keys: Record<string, () => void> = {
      ArrowLeft: () => player.seek(player.step - 1),
      ArrowRight: () => player.seek(player.step + 1),
      Home: () => player.seek(0),
      End: () => player.newest(),
      p: () => player.play(!player.plays),
    };
    keys[event.key]?.();
  });
  setInterval(() => player.tick(), TICK_MS);
  await poll();
  document.documentElement.dataset.ready = "true";
}

function table(rows: HTMLElement): HTMLElement {
  const head = ["name", "role", "state"].map((name) => h("th", {}, name));
  const counts = [
    h("th", { class: "number", title: "known, percent of the cells that can be reached" }, "%"),
    h(
      "th",
      { class: "number", title: "free cells that it has to bring to the base itself" },
      "own",
    ),
  ];
  return h("table", {}, h("thead", {}, h("tr", {}, ...head, ...counts)), rows);
}

function row(one: Figure, share: number | undefined): HTMLElement {
  const words = [one.name, one.role, one.works ? one.state : "failed"];
  return h(
    "tr",
    {},
    ...words.map((word) => h("td", {}, word)),
    h("td", { class: "number" }, (share ?? 0).toFixed(1)),
    h("td", { class: "number" }, String(one.own)),
  );
}

main().catch((error: Error) => {
  document.body.append(h("p", { class: "fault" }, `The page cannot be shown: ${error.message}`));
});
