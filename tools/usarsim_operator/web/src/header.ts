// The header: mission clock, scenario, link, pace (instructor), theme, keys, emergency stop.

import { belowHeader, dialog } from "./dialog";
import { button, h, mark, say } from "./dom";
import type { Link } from "./link";
import { follow, listbox } from "./listbox";
import type { State } from "./protocol";
import { clockText, isStale, LOOK_MS } from "./staleness";
import { stopButton } from "./stop";
import { pageTime, type Store } from "./store";
import { switchTheme } from "./theme";

const RESETS = [
  [
    "Goes back",
    "every robot to where it came in; doors, lifts, obstacles, victims, crates, conveyors, tags and batteries.",
  ],
  ["Begins anew", "the clock of the mission, marks, alarms, and the ways on the map."],
  [
    "Goes on",
    "simulated time, odometry, the map that robots have made, who holds which robot, and smoke.",
  ],
] as const;
const SPEEDS = [0.25, 0.5, 1, 2, 4];

export function header(store: Store, link: Link, openKeys: () => void): HTMLElement {
  const clock = h(
    "output",
    { class: "clock", "data-clock": true, "aria-label": "time of the mission" },
    "--:--",
  );
  const remaining = h("span", { class: "quiet", "data-remaining": true });
  const scenario = h("span", { class: "scenario", "data-scenario": true });
  const role = button("", "name", () => nameDialog(store, link), "who you are: others see it");
  role.classList.add("chip");
  const world = h("span", { class: "chip world", "data-world": "unknown", role: "status" });
  const state = h(
    "span",
    { class: "chip link", "data-link": "lost", role: "status" },
    "connecting",
  );
  const pace = paceTools(store, link);
  const items = h(
    "div",
    { class: "header-items" },
    h("h1", {}, "usarsim"),
    h("div", { class: "clock-box" }, clock, remaining),
    world,
    scenario,
    role,
    pace,
    h("div", { class: "spring" }),
    state,
    button("Keys", "keys", openKeys, "keys and pad"),
    button("◐", "theme", () => theme(store), "dark or light"),
  );
  const element = h("header", { class: "header" }, items, stopButton(store, link));
  belowHeader(element);
  element.querySelector('[data-do="theme"]')?.setAttribute("aria-label", "dark or light");

  const draw = (): void => {
    const now = pageTime();
    const told = store.state;
    const silent = isStale(store.ages.silence(now));
    mark(element, "data-stale", silent);
    if (told) {
      const time = store.ages.simulated(now);
      say(clock, clockText(store.mission(time)));
      clock.title = `simulated time ${clockText(time)}`;
      say(remaining, missionText(told.mission));
      mark(remaining, "data-score", told.mission?.score?.toString() ?? null);
      say(scenario, told.mission?.name ?? store.welcome?.server.level ?? "");
    }
    mark(element, "data-paused", told?.paused ?? false);
    mark(world, "data-world", !told || silent ? "unknown" : told.paused ? "paused" : "runs");
    say(world, worldText(told, silent));
    world.title = told ? `asked: ${told.speed} simulated s per s` : "";
    say(role, whoText(store, link));
    mark(document.documentElement, "data-role", store.welcome?.role ?? null);
    role.hidden = !store.welcome;
    const live = store.connected && !silent;
    mark(state, "data-link", live ? "good" : "lost");
    say(state, live ? linkText(store) : store.refused || (store.connected ? "no data" : "no link"));
    state.title = live ? linkTitle(store) : "";
  };
  store.on("state", draw);
  store.on("link", draw);
  store.on("welcome", draw);
  setInterval(draw, LOOK_MS);
  return element;
}

/** Who this is, as what, and how much later than it happens a viewer sees it. */
function whoText({ welcome }: Store, link: Link): string {
  if (!welcome) return "";
  const late = welcome.delay_s ? `, ${welcome.delay_s} s late` : "";
  return `${link.name}${link.named ? ` · ${welcome.role}` : ""}${late}`;
}

/** There and back in ms, and what is lost where that matters. */
function linkText({ rtt, losses }: Store): string {
  const ms = Number.isFinite(rtt) ? ` ${Math.round(1000 * rtt)} ms` : "";
  return `link${ms}${losses.share >= 0.005 ? ` · ${(100 * losses.share).toFixed(0)} % lost` : ""}`;
}

/** What was measured here: delay one way by pings, loss by the numbers of frames. */
function linkTitle({ rounds, losses, welcome }: Store): string {
  const delay = Number.isFinite(rounds.delay)
    ? `delay ${(1000 * rounds.delay).toFixed(rounds.delay < 0.01 ? 1 : 0)} ms each way (pings)`
    : "delay not measured yet";
  if (!welcome?.numbered || losses.sent === 0) return delay;
  return `${delay}; loss ${(100 * losses.share).toFixed(1)} % of ${losses.sent} frames (last minute)`;
}

/** How the world goes: paused, or at which pace in truth. */
function worldText(told: State | null, silent: boolean): string {
  if (!told || silent) return "no news";
  if (told.paused) return "paused";
  const factor = told.real_time_factor ?? told.speed ?? 1;
  return `runs ${factor.toFixed(factor < 9.95 ? 2 : 0)}×`;
}

/** Asks who drives here; the gateway hears it by a new hello. */
function nameDialog(store: Store, link: Link): void {
  const name = h("input", { type: "text", maxlength: 40, "data-field": "name", required: true });
  name.value = link.named ? link.name : "";
  name.placeholder = link.name;
  const told = store.welcome?.role === "viewer" ? "" : "Robots that you hold are let go of.";
  const body = [h("label", {}, "Your name", name), h("p", { class: "quiet" }, told)];
  dialog("Who are you?", body, "Save", () => {
    const wanted = name.value.trim();
    if (wanted === "" || (link.named && wanted === link.name)) return;
    localStorage.setItem("usarsim-name", wanted);
    link.rename(wanted);
  });
}

function paceTools(store: Store, link: Link): HTMLElement {
  const act = (action: string, more: object = {}): void => {
    link.request({ type: "pace", action, ...more });
  };
  const run = button("Pause", "pause", () => act(store.state?.paused ? "run" : "pause"));
  const step = button("Step", "step", () => act("step", { seconds: 0.1 }), "0.1 s further");
  const speed = listbox(
    { "data-do": "speed", "aria-label": "speed of the world" },
    SPEEDS.map((factor) => [String(factor), `${factor}×`]),
  );
  speed.value = "1";
  speed.addEventListener("change", () => act("speed", { factor: Number(speed.value) }));
  const reset = button("Reset", "reset", () => {
    const body = RESETS.map(([what, which]) => h("p", {}, h("b", {}, `${what}: `), which));
    dialog("Reset the world?", body, "Reset", () => act("reset"));
  });
  reset.title = "begin the mission anew; asks first, and says what it resets";
  const element = h(
    "div",
    { class: "pace", "data-pace": true, hidden: true },
    run,
    step,
    h("span", { class: "drop" }, speed),
    reset,
  );
  store.on("state", () => {
    say(run, store.state?.paused ? "Run" : "Pause");
    const factor = store.state?.speed ?? 1;
    if (SPEEDS.includes(factor)) follow(speed, String(factor));
  });
  store.on("welcome", () => {
    const { role, features } = store.welcome ?? {};
    element.hidden = !(role === "instructor" && features?.pace);
  });
  return element;
}

function theme(store: Store): void {
  switchTheme();
  store.tell("theme");
}

/** What the mission reveals: time left, who was found, points. */
export function missionText(mission: State["mission"]): string {
  const { remaining = null, found, victims, score } = mission ?? {};
  const of = victims === undefined ? "" : ` of ${victims}`;
  return [
    remaining === null ? "" : `${clockText(remaining)} left`,
    found === undefined ? "" : `${found}${of} found`,
    score === undefined ? "" : `${Number(score.toFixed(1))} points`,
  ]
    .filter((text) => text !== "")
    .join(" · ");
}
