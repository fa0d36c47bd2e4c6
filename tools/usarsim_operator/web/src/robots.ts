// The list of robots, and the card of the chosen one: who drives, mode, battery, link, bumpers, sensors.

import { button, h, mark, panel, say } from "./dom";
import { isOthers } from "./input";
import type { Link } from "./link";
import { markIcon, robotColour, setMark } from "./looks";
import { more } from "./more";
import type { Robot } from "./protocol";
import { ageText, isStale, LOOK_MS } from "./staleness";
import { pageTime, type Store } from "./store";
import { ring, ZONE_LETTERS } from "./tiles";
import { emptyNote, newsText, waitText } from "./waiting";

const SOURCES: Record<string, string> = {
  GroundTruth: "truth",
  Odometry: "odometry",
  Truth: "true pose",
};

function holderText(store: Store, robot: Robot): string {
  if (!robot.holder) return isOthers(store, robot) ? `operator ${robot.seat}'s` : "free";
  return robot.holder.page === store.welcome?.page ? "you drive" : robot.holder.name;
}

export function robotList(store: Store): HTMLElement {
  const list = h("div", {
    class: "robots",
    role: "listbox",
    "aria-label": "Robots",
    tabindex: "0",
  });
  const none = emptyNote(store, (now) => newsText(store, now));
  const element = panel("robots", "Robots", [], list, none);
  const rows = new Map<string, HTMLElement>();
  list.addEventListener("keydown", (event) => {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (step === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    const place = store.robots.findIndex((robot) => robot.name === store.selected);
    const next = store.robots[place + step];
    if (next) store.select(next.name);
  });
  const update = (): void => {
    const now = pageTime();
    for (const [name, row] of rows) {
      if (store.robots.some((robot) => robot.name === name)) continue;
      row.remove();
      rows.delete(name);
    }
    store.robots.forEach((robot, place) => {
      let row = rows.get(robot.name);
      if (!row) {
        row = robotRow(() => store.select(robot.name));
        row.id = `robot-${place}`;
        rows.set(robot.name, row);
        list.append(row);
      }
      const part = (name: string): Element => row.querySelector(`[data-f="${name}"]`) ?? row;
      const selected = robot.name === store.selected;
      row.style.setProperty("--robot", robotColour(robot.index));
      setMark(part("mark"), robot.index);
      row.dataset.robot = robot.name;
      mark(row, "aria-selected", selected);
      if (selected) list.setAttribute("aria-activedescendant", row.id);
      mark(row, "data-stale", isStale(store.ages.ofReport(robot.link.age, now)));
      say(part("digit"), place < 10 ? String((place + 1) % 10) : "");
      say(part("name"), robot.name);
      say(part("class"), robot.class);
      say(part("holder"), robot.failed ? "⚠ failed" : holderText(store, robot));
      say(part("zone"), ZONE_LETTERS[robot.zone ?? ""] ?? "");
      mark(part("zone"), "data-zone", robot.zone ?? "");
      mark(part("link"), "data-link", robot.link.state);
      say(part("link"), { good: "▮▮▮", weak: "▮▯▯", lost: "✕" }[robot.link.state]);
      part("link").setAttribute("title", `link ${robot.link.state}`);
      say(part("battery"), robot.battery === null ? "–" : `${Math.round(100 * robot.battery)} %`);
    });
  };
  store.on("state", update);
  store.on("select", () => {
    update();
    rows.get(store.selected)?.scrollIntoView({ block: "nearest" });
  });
  setInterval(update, LOOK_MS);
  return element;
}

function robotRow(select: () => void): HTMLElement {
  const icon = markIcon();
  mark(icon, "data-f", "mark");
  const f = (name: string, cls: string): HTMLElement => h("span", { class: cls, "data-f": name });
  return h(
    "div",
    { class: "robot-row", role: "option", onclick: select },
    f("digit", "digit"),
    icon,
    h("span", { class: "robot-names" }, f("name", "robot-name"), f("class", "quiet")),
    h(
      "span",
      { class: "robot-facts" },
      h("span", {}, f("zone", "zone"), f("battery", "number"), f("link", "bars")),
      f("holder", "quiet"),
    ),
  );
}

export function robotCard(store: Store, link: Link): HTMLElement {
  const fields: Record<string, HTMLElement> = {};
  const field = (name: string, label: string): HTMLElement => {
    const value = h("dd", { "data-field": name });
    fields[name] = value;
    return h("div", {}, h("dt", {}, label), value);
  };
  const front = h("div", { class: "ring front", "data-ring": "front" });
  const rear = h("div", { class: "ring rear", "data-ring": "rear" });
  const plan = h(
    "div",
    { class: "bumper-plan", role: "img", "aria-label": "bumpers", hidden: true },
    front,
    h("b"),
    rear,
  );
  const robotOr = (act: (robot: Robot) => void) => () => {
    if (store.robot) act(store.robot);
  };
  const take = button("Take", "take", () => takeOrBack(store, link));
  const named = (): void => {
    take.title = store.keys.of("take");
  };
  named();
  store.on("bindings", named);
  const force = button(
    "Force",
    "force",
    robotOr((r) => {
      link.request({ type: "take", robot: r.name, force: true });
    }),
    "take it by force",
  );
  const enable = button(
    "Disable",
    "enable",
    robotOr((r) => {
      link.request({ type: "enable", robot: r.name, on: !r.enabled });
    }),
  );
  const light = button(
    "Light",
    "light",
    robotOr((r) => {
      link.request({ type: "light", robot: r.name, on: !r.light });
    }),
  );
  const meter = h("meter", { min: 0, max: 1, low: 0.3, optimum: 1, "aria-label": "battery" });
  const sensors = h("ul", {
    class: "sensors",
    "data-sensors": true,
    "aria-label": "sensors",
    tabindex: "0",
  });
  const icon = markIcon();
  const title = h("h2", { "data-selected": true }, "No robot");
  const element = h(
    "section",
    { class: "panel card", "data-panel": "card", "aria-label": "Chosen robot" },
    h(
      "div",
      { class: "panel-head" },
      icon,
      title,
      h("div", { class: "tools" }, take, force, enable, light),
    ),
    h(
      "div",
      { class: "card-body" },
      h(
        "dl",
        { class: "facts" },
        field("holder", "Driver"),
        field("mode", "Mode"),
        field("speed", "Speed"),
        field("zone", "Zone"),
        field("pose", "Place"),
        field("link", "Link"),
        field("battery", "Battery"),
      ),
      plan,
    ),
    sensors,
    emptyNote(store, (now) => {
      const { robot } = store;
      if (!robot || robot.sensors.length > 0) return newsText(store, now);
      return waitText(store, `report of ${robot.name}`, now);
    }),
    more(store, link),
  );
  fields.battery?.after(h("dd", {}, meter));

  const update = (): void => {
    const { robot } = store;
    if (!robot) return;
    const now = pageTime();
    const set = (name: string, text: string): void => {
      if (fields[name]) say(fields[name], text);
    };
    const age = store.ages.ofReport(robot.pose_age, now);
    mark(element, "data-stale", isStale(store.ages.silence(now)) || isStale(age));
    say(title, robot.name);
    setMark(icon, robot.index);
    set("holder", holderText(store, robot));
    const policy = robot.mode === "autonomous" ? robot.policy : null;
    set(
      "mode",
      robot.enabled
        ? [robot.mode, policy].filter(Boolean).join(" · ")
        : robot.failed
          ? "failed"
          : "disabled",
    );
    set("speed", `${robot.speed.toFixed(2)} m/s`);
    set("zone", robot.zone ?? "none");
    set(
      "pose",
      robot.pose
        ? `${robot.pose[0].toFixed(1)}, ${robot.pose[1].toFixed(1)} m · ${SOURCES[robot.pose_source] ?? robot.pose_source}`
        : "unknown",
    );
    const dbm = robot.link.signal_dbm;
    set("link", `${robot.link.state}${dbm === null ? "" : ` ${dbm.toFixed(0)} dBm`}`);
    set("battery", robot.battery === null ? "unknown" : `${Math.round(100 * robot.battery)} %`);
    meter.hidden = robot.battery === null;
    meter.value = robot.battery ?? 0;
    plan.hidden = robot.bumpers.length === 0;
    ring(front, robot, "front");
    ring(rear, robot, "rear");
    const viewer = store.welcome?.role === "viewer";
    say(take, store.mine ? "Hand back" : robot.holder ? "Ask for it" : "Take");
    say(enable, robot.enabled ? "Disable" : "Enable");
    const others = isOthers(store, robot);
    for (const b of [take, enable, light]) b.disabled = others;
    if (robot.failed) enable.disabled = true;
    mark(light, "aria-pressed", robot.light);
    for (const b of [take, enable, light]) b.hidden = viewer;
    force.hidden = store.welcome?.role !== "instructor" || store.mine || !robot.holder;
    sensors.replaceChildren(
      ...robot.sensors.map((sensor) => {
        const old = store.ages.ofReport(sensor.age, now);
        const item = h("li", {
          "data-sensor": sensor.name,
          "data-stale": String(sensor.stale || isStale(old)),
        });
        item.append(
          h("span", {}, sensor.name),
          h("span", { class: "number" }, `${sensor.rate_hz.toFixed(0)} Hz · ${ageText(old)}`),
        );
        return item;
      }),
    );
  };
  store.on("state", update);
  store.on("select", update);
  setInterval(update, LOOK_MS);
  return element;
}

/** Takes the chosen robot, asks its holder for it, or hands it back. */
export async function takeOrBack(store: Store, link: Link): Promise<void> {
  const { robot } = store;
  if (!robot) return;
  const type = store.mine ? "hand_back" : "take";
  const other = store.mine ? null : robot.holder;
  if (other && other.page !== null) store.tell("notice", `asking ${other.name} for ${robot.name}`);
  if ((await link.request({ type, robot: robot.name })) && other)
    store.tell("notice", `${robot.name} is yours`);
}
