// The chosen robot's protocol lines: what its client sent, how that was read, what it did, and why not.

import { button, h, mark, panel, say } from "./dom";
import type { Link } from "./link";
import type { LineRow } from "./protocol";
import type { Store } from "./store";

const MOST_SHOWN = 120;
const STREAM = /^(SEN|STA)\b/;

/** Rows to show, newest first: of lines that repeat, one with their count. */
export function gathered(
  rows: LineRow[],
  keep: (row: LineRow) => boolean,
): { row: LineRow; count: number }[] {
  const found: { row: LineRow; count: number }[] = [];
  for (let i = rows.length - 1; i >= 0 && found.length < MOST_SHOWN; i--) {
    const row = rows[i];
    if (!row || !keep(row)) continue;
    const last = found.at(-1);
    if (last && last.row.text === row.text && last.row.effect === row.effect) last.count += 1;
    else found.push({ row, count: 1 });
  }
  return found;
}

export function lines(
  store: Store,
  link: Link,
): { element: HTMLElement; open: (on: boolean) => void } {
  const table = h("ol", {
    class: "lines",
    "data-lines": true,
    tabindex: "0",
    "aria-label": "protocol lines",
  });
  const faults = h("input", { type: "checkbox", "data-do": "faults" });
  const streams = h("input", { type: "checkbox", "data-do": "streams" });
  const lost = h("span", { class: "quiet", "data-lost": true });
  const held = button("Hold", "hold", () => {
    mark(held, "aria-pressed", held.getAttribute("aria-pressed") !== "true");
    draw();
  });
  const element = panel(
    "lines",
    "Protocol lines",
    [
      lost,
      h("label", {}, faults, "faults only"),
      h("label", {}, streams, "sensors and status"),
      held,
    ],
    table,
  );
  element.hidden = true;
  const title = element.querySelector("h2");
  const draw = (): void => {
    if (title) say(title, `Protocol lines of ${store.selected}`);
    if (held.getAttribute("aria-pressed") === "true" || element.hidden) return;
    const keep = (row: LineRow): boolean =>
      (!faults.checked || !!row.fault) && (streams.checked || !STREAM.test(row.text));
    const rows = gathered(store.lines.get(store.selected) ?? [], keep);
    table.replaceChildren(...rows.map(({ row, count }) => lineRow(row, count)));
    if (rows.length === 0) {
      const why = store.welcome?.features.lines
        ? "nothing yet: its client has sent no such line"
        : "this server does not tell its lines";
      table.append(h("li", { class: "quiet" }, why));
    }
    const n = store.lost.get(store.selected) ?? 0;
    say(lost, n > 0 ? `${n} left out` : "");
  };
  for (const box of [faults, streams]) box.addEventListener("change", draw);
  let waits = false;
  const later = (): void => {
    if (waits) return;
    waits = true;
    setTimeout(() => {
      waits = false;
      draw();
    }, 200);
  };
  for (const topic of ["lines", "select", "welcome"] as const) store.on(topic, later);
  const ask = (): void => {
    if (store.welcome?.features.lines && store.welcome.role === "instructor")
      link.send({ type: "lines", robot: element.hidden ? null : store.selected });
  };
  store.on("select", ask);
  store.on("welcome", ask);
  const open = (on: boolean): void => {
    element.hidden = !on;
    ask();
    draw();
  };
  return { element, open };
}

function lineRow(row: LineRow, count: number): HTMLElement {
  const sent = row.direction === "in";
  const wrong = !!row.fault;
  const nothing = row.effect === "none";
  const item = h(
    "li",
    { "data-direction": row.direction, "data-fault": String(wrong) },
    h("span", { class: "number quiet" }, row.time.toFixed(2)),
    h(
      "span",
      { class: "way", role: "img", "aria-label": sent ? "to the server" : "from the server" },
      sent ? "▶" : "◀",
    ),
    h("code", {}, row.text, count > 1 ? h("b", { class: "times" }, `×${count}`) : null),
  );
  if (row.reading || row.effect)
    item.append(
      h(
        "p",
        { class: "reading" },
        row.reading ? h("code", {}, row.reading) : null,
        h(
          "span",
          { class: "effect", "data-effect": nothing ? "none" : "some" },
          nothing ? "no effect" : (row.effect ?? ""),
        ),
      ),
    );
  for (const fault of (row.fault ?? "").split(/; (?!did you mean)/).filter((text) => text !== ""))
    item.append(h("p", { class: "fault" }, fault));
  return item;
}
