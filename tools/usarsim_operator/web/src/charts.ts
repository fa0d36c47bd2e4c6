// Charts of the chosen robot over the last two minutes: speed, battery, and its link (signal where the server
// tells one, else how long ago the robot was heard).

import uPlot from "uplot";
import { button, colour, h, mark, panel, rem, say } from "./dom";
import { robotColour } from "./looks";
import { agoText } from "./staleness";
import type { Sample, Store } from "./store";
import { emptyNote, waitText } from "./waiting";

interface Series {
  name: string;
  range: (low: number, high: number) => [number, number];
  of: (s: Sample) => number | null;
  text: (value: number) => string;
}

const SPEED: Series = {
  name: "Speed",
  range: (low, high) => [Math.min(0, low), Math.max(0.5, high)],
  of: (s) => s.speed,
  text: (speed) => `${speed.toFixed(2)} m/s`,
};
const BATTERY: Series = {
  name: "Battery",
  range: () => [0, 100],
  of: (s) => (s.battery === null ? null : 100 * s.battery),
  text: (share) => `${share.toFixed(0)} %`,
};
const SIGNAL: Series = {
  name: "Signal",
  range: () => [-100, -20],
  of: (s) => s.signal,
  text: (dbm) => `${dbm.toFixed(0)} dBm`,
};
const SILENCE: Series = {
  name: "Last heard",
  range: (_low, high) => [0, Math.max(1, high)],
  of: (s) => s.age,
  text: agoText,
};
/** Height of the axis of time, px of a rem of 16. */
const AXIS = 18;
const SPAN_S = 120;

export function charts(store: Store, linesButton: HTMLElement): HTMLElement {
  const box = h("div", { class: "charts", "data-charts": true });
  let made: { series: Series; plot: uPlot; value: HTMLElement }[] = [];
  const recent = (): Sample[] => {
    const all = store.history.get(store.selected) ?? [];
    const from = (all.at(-1)?.time ?? 0) - SPAN_S;
    return all.filter((s) => s.time > from);
  };
  const chosen = (): Series[] => [
    SPEED,
    BATTERY,
    recent().some((s) => s.signal !== null) ? SIGNAL : SILENCE,
  ];
  const size = (last: boolean): { width: number; height: number } => ({
    width: Math.max(120, box.clientWidth - 4),
    height: Math.max(34, (box.clientHeight - rem(AXIS)) / 3 - rem(17)) + (last ? rem(AXIS) : 0),
  });
  const fill = (): void => {
    const samples = recent();
    const times = samples.map((s) => s.time);
    for (const { series, plot, value } of made) {
      plot.setData([times, samples.map(series.of)]);
      const last = samples.at(-1);
      const now = last ? series.of(last) : null;
      say(value, now === null ? "unknown" : series.text(now));
    }
  };
  const make = (): void => {
    for (const { plot } of made) plot.destroy();
    box.replaceChildren();
    made = [];
    if (box.clientWidth === 0) return;
    const line = robotColour(store.robot?.index ?? 0);
    made = chosen().map((series, i, all) => {
      const last = i === all.length - 1;
      const value = h("output", { class: "number" });
      const figure = h(
        "figure",
        { "data-chart": series.name.toLowerCase() },
        h("figcaption", {}, h("span", {}, series.name), value),
      );
      box.append(figure);
      const plot = new uPlot(options(series, line, last, size(last)), [[], []], figure);
      return { series, plot, value };
    });
    fill();
  };
  new ResizeObserver(() => {
    if (made.length === 0) make();
    made.forEach(({ plot }, i) => {
      plot.setSize(size(i === made.length - 1));
    });
  }).observe(box);
  for (const topic of ["select", "theme"] as const) store.on(topic, make);
  let last = 0;
  store.on("state", () => {
    if (performance.now() - last < 500 || box.clientWidth === 0) return;
    last = performance.now();
    if (made[2] && made[2].series !== chosen()[2]) make();
    else fill();
  });
  const none = emptyNote(store, (now) =>
    recent().length > 0 ? "" : waitText(store, `report of ${store.selected}`, now),
  );
  return panel("details", "Last two minutes", [linesButton], none, box);
}

function options(
  series: Series,
  line: string,
  last: boolean,
  size: { width: number; height: number },
): uPlot.Options {
  const axis = {
    stroke: colour("quiet"),
    grid: { stroke: colour("line"), width: 1 },
    ticks: { show: false },
    font: `${rem(10)}px ${colour("font")}`,
    gap: 3,
  };
  return {
    ...size,
    legend: { show: false },
    cursor: { show: false },
    scales: { x: { time: false }, y: { range: (_u, low, high) => series.range(low, high) } },
    axes: [
      {
        ...axis,
        size: last ? rem(AXIS) : 0,
        space: rem(64),
        values: (_u, at) => at.map((s) => (last ? `${s} s` : "")),
      },
      { ...axis, size: rem(34), space: rem(18) },
    ],
    series: [
      {},
      { label: series.name, stroke: line, width: 1.75, points: { show: false }, spanGaps: false },
    ],
    padding: [rem(6), rem(8), last ? 0 : rem(4), 0],
  };
}

/** The button that opens and closes the protocol lines; only instructors have any. */
export function linesButton(store: Store, toggled: (open: boolean) => void): HTMLButtonElement {
  const b = button("Lines", "choose-lines", () => {
    const open = b.getAttribute("aria-pressed") !== "true";
    mark(b, "aria-pressed", open);
    toggled(open);
  });
  b.title = "protocol lines of this robot, explained";
  mark(b, "aria-pressed", false);
  b.hidden = true;
  store.on("welcome", () => {
    const { role, features } = store.welcome ?? {};
    b.hidden = !(role === "instructor" && features?.lines);
  });
  return b;
}
