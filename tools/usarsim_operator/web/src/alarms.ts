// Alarms, marks, notices and questions: at most five lines of alarms, the gravest first.

import { button, h, panel, say } from "./dom";
import type { Link } from "./link";
import { markIcon } from "./looks";
import type { Alarm } from "./protocol";
import { clockText } from "./staleness";
import type { Store } from "./store";

export const MOST_ALARMS = 5;

/** The alarms to show: not acknowledged first, then by severity (3 is gravest), then the newest. */
export function shown(alarms: Alarm[]): Alarm[] {
  const open = (alarm: Alarm): number => Number(alarm.acknowledged);
  return [...alarms]
    .sort((a, b) => open(a) - open(b) || b.severity - a.severity || b.since - a.since)
    .slice(0, MOST_ALARMS);
}

const SIGNS = { 1: "○", 2: "△", 3: "■" };

export function alarmList(store: Store, link: Link): HTMLElement {
  const list = h("ol", { class: "alarms", "data-alarms": true, "aria-live": "polite" });
  const more = h("p", { class: "quiet", "data-alarms-hidden": true }, "no news yet");
  const all = button("Acknowledge", "acknowledge", () => acknowledgeFirst(store, link));
  const named = (): void => {
    all.title = store.keys.of("acknowledge");
  };
  named();
  store.on("bindings", named);
  const element = panel("alarms", "Alarms", [all], list, more);
  let before = "";
  store.on("state", () => {
    const { alarms = [], alarms_hidden = 0 } = store.state ?? {};
    const rows = shown(alarms);
    const hidden = alarms_hidden + alarms.length - rows.length;
    say(more, hidden > 0 ? `and ${hidden} more` : rows.length === 0 ? "none" : "");
    all.disabled = !rows.some((alarm) => !alarm.acknowledged);
    const key = JSON.stringify(rows);
    if (key === before) return;
    before = key;
    list.replaceChildren(
      ...rows.map((alarm) =>
        h(
          "li",
          {
            "data-alarm": alarm.id,
            "data-severity": alarm.severity,
            "data-acknowledged": String(alarm.acknowledged),
          },
          h(
            "span",
            { class: "sign", "aria-label": `severity ${alarm.severity}` },
            SIGNS[alarm.severity],
          ),
          markOf(store, alarm.robot),
          h(
            "button",
            { type: "button", class: "plain", onclick: () => store.select(alarm.robot) },
            `${alarm.robot}: ${alarm.text}`,
          ),
          h(
            "span",
            { class: "number quiet" },
            (alarm.count > 1 ? `${alarm.count}× ` : "") + clockText(store.mission(alarm.since)),
          ),
        ),
      ),
    );
  });
  return element;
}

/** The mark of a robot by its name; none of one that has left. */
function markOf(store: Store, name: string): Element | null {
  const robot = store.robots.find((one) => one.name === name);
  return robot ? markIcon(robot.index) : null;
}

export function acknowledgeFirst(store: Store, link: Link): void {
  const first = shown(store.state?.alarms ?? []).find((alarm) => !alarm.acknowledged);
  if (first) link.request({ type: "acknowledge", alarm: first.id });
}

export function markList(store: Store, link: Link, edit: (id: number) => void): HTMLElement {
  const early = h("li", { class: "quiet" }, "no news yet");
  const list = h("ol", { class: "marks", "data-marks": true }, early);
  const element = panel("marks", "Victims marked", [], list);
  let before = "";
  store.on("bindings", () => {
    before = "";
  });
  store.on("state", () => {
    const marks = store.state?.marks ?? [];
    const key = JSON.stringify(marks);
    if (key === before) return;
    before = key;
    list.replaceChildren(
      ...marks.map((one, place) =>
        h(
          "li",
          { "data-mark": one.id },
          h("span", { class: "sign" }, `V${place + 1}`),
          h("span", {}, `${one.status || "unknown"} ${one.note}`),
          button("Edit", "mark-edit", () => edit(one.id)),
          button("Delete", "mark-delete", () => {
            link.request({ type: "mark_delete", mark: one.id });
          }),
        ),
      ),
    );
    const none =
      store.welcome?.role === "viewer" ? "none" : `none; ${store.keys.of("mark")} marks one`;
    if (marks.length === 0) list.append(h("li", { class: "quiet" }, none));
  });
  return element;
}

/** What somebody who wants this page's robot asks; in a row of the page, so that it lies over no control. */
export function questions(store: Store, link: Link): HTMLElement {
  const element = h("div", { class: "questions", "data-questions": true });
  store.on("asked", (question) => {
    const { robot, page, name } = question as { robot: string; page: number; name: string };
    // Not a dialog: that would take the keys from one who drives, and stop the robot.
    const reply = (grant: boolean) => () => {
      card.remove();
      link.request({ type: "reply", robot, to: page, grant });
    };
    const title = `${name} asks for ${robot}`;
    const keep = button("Keep", "keep", reply(false));
    const give = button("Hand over", "hand-over", reply(true));
    const card = h(
      "section",
      { class: "question", role: "alertdialog", "aria-label": title, "data-asked": robot },
      h("h2", {}, title),
      keep,
      give,
    );
    element.append(card);
    setTimeout(() => card.remove(), 10_000);
  });
  return element;
}

/** Notices for a few seconds. */
export function notices(store: Store): HTMLElement {
  const element = h("div", { class: "notices", "data-notices": true, role: "status" });
  const show = (text: string): void => {
    const note = h("p", {}, text);
    element.append(note);
    while (element.children.length > 3) element.firstChild?.remove();
    setTimeout(() => note.remove(), 5000);
  };
  store.on("notice", (text) => show(String(text)));
  store.on("event", (event) => {
    const { robot, kind, value } = event as { robot: string; kind: string; value: unknown };
    if (kind === "message") show(String(value));
    if (kind === "sound") show(`${robot} hears something (${Number(value).toFixed(0)} dB)`);
    if (kind === "timed_move") show(`${robot}: move ${String(value)}`);
    // The state of before is still known here: whose the robot was.
    const before = store.robots.find((one) => one.name === robot)?.holder?.page;
    const taker = value as { page: number; name: string } | null;
    if (kind === "lock" && taker && before === store.welcome?.page && taker.page !== before)
      show(`${taker.name} drives ${robot} now`);
  });
  return element;
}
