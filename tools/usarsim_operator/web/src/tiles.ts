// Camera tiles, one per robot; the chosen one is larger. A picture older than 1 s is greyed and says so; a
// camera that is off or absent shows no picture at all.

import { button, flat, h, mark, rem, say } from "./dom";
import { layout } from "./grid";
import type { Link } from "./link";
import { markIcon, robotColour, setMark } from "./looks";
import { markButton } from "./marking";
import type { Robot, Vector } from "./protocol";
import { columnOfPlace, fromRobot } from "./sighting";
import { ageText, isStale, LOOK_MS } from "./staleness";
import { pageTime, type Store } from "./store";
import { emptyNote, newsText, waitText } from "./waiting";

export const ZONE_LETTERS: Record<string, string> = {
  yellow: "Y",
  orange: "O",
  red: "R",
  blue: "B",
};

/** Gap of the tiles, height of what else their panel holds, and the least of all tiles, px of a rem of 16. */
const GAP = 4;
const HEAD = 40;
const LEAST = 150;

class Tile {
  readonly element: HTMLElement;
  readonly canvas = h("canvas", { width: 320, height: 240 });
  private readonly mark = markIcon();
  private readonly name = h("span", { class: "tile-name", "data-name": true });
  private readonly age = h("span", { class: "tile-age", "data-age": true });
  private readonly zone = h("span", { class: "zone", "data-zone": "" });
  private readonly facts = h("span", { class: "tile-facts" });
  private readonly note = h("span", { class: "tile-note" });
  private readonly aim = h("span", { class: "tile-aim", "data-aim": true, hidden: true });
  private readonly front = h("div", { class: "ring front", "data-ring": "front" });
  private readonly rear = h("div", { class: "ring rear", "data-ring": "rear" });

  constructor(store: Store, name: string, clicked: (column: number, event: MouseEvent) => void) {
    this.element = h(
      "button",
      { type: "button", class: "tile", "data-tile": name, "data-stale": "true" },
      this.canvas,
      this.front,
      this.rear,
      this.note,
      this.aim,
      h("span", { class: "tile-top" }, this.mark, this.name, this.zone, this.age),
      this.facts,
    );
    this.element.addEventListener("click", (event) => {
      const again = store.selected === name;
      store.select(name);
      const box = this.canvas.getBoundingClientRect();
      if (store.armed || (again && event.detail > 1))
        clicked((event.clientX - box.left) / box.width - 0.5, event);
    });
  }

  /** Shows in which column a mark is about to go, and how far away. */
  aimAt(robot: Robot, place: Vector | null): void {
    const column = place && columnOfPlace(robot, place);
    this.aim.hidden = column === null;
    if (column === null || !place || !robot.pose) return;
    this.aim.style.left = `${(100 * (column + 0.5)).toFixed(2)}%`;
    say(this.aim, `${fromRobot(robot.pose, place).distance.toFixed(1)} m`);
  }

  picture(image: ImageBitmap): void {
    if (this.canvas.width !== image.width) this.canvas.width = image.width;
    if (this.canvas.height !== image.height) this.canvas.height = image.height;
    flat(this.canvas)?.drawImage(image, 0, 0);
  }

  update(robot: Robot, age: number, selected: boolean, silent: boolean, waits: string): void {
    const on = robot.camera?.on ?? false;
    const never = !Number.isFinite(age);
    const stale = isStale(age) || silent;
    say(this.name, robot.name);
    say(this.age, on && !never ? ageText(age) : "");
    mark(this.element, "data-stale", stale);
    mark(
      this.element,
      "data-camera",
      robot.camera ? (on ? (never ? "waiting" : "on") : "off") : "none",
    );
    mark(this.element, "aria-pressed", selected);
    mark(this.element, "data-link", robot.link.state);
    const lost = robot.link.state === "lost";
    say(
      this.note,
      !robot.camera
        ? robot.learned === false
          ? "asking what it carries"
          : "no camera"
        : !on
          ? "camera off"
          : never
            ? waits
            : lost
              ? "link lost"
              : stale
                ? "frozen"
                : "",
    );
    mark(this.zone, "data-zone", robot.zone ?? "");
    say(this.zone, ZONE_LETTERS[robot.zone ?? ""] ?? "");
    const battery = robot.battery === null ? "" : `${Math.round(100 * robot.battery)} %`;
    say(this.facts, [robot.mode, battery].filter((text) => text !== "").join(" · "));
    ring(this.front, robot, "front");
    ring(this.rear, robot, "rear");
    setMark(this.mark, robot.index);
    this.element.style.setProperty("--robot", robotColour(robot.index));
  }
}

/** What the free cell of the grid says: how many robots, who drives, the lowest battery. */
function teamText(element: HTMLElement, store: Store, roomy: boolean): void {
  const { robots } = store;
  const driven = robots.filter((robot) => robot.holder !== null).length;
  const batteries = robots.flatMap((robot) => (robot.battery === null ? [] : [robot.battery]));
  const lost = robots.filter((robot) => robot.link.state === "lost").length;
  const facts: [string, string][] = [
    [String(robots.length), robots.length === 1 ? "robot" : "robots"],
    [String(driven), "driven"],
  ];
  if (roomy && batteries.length > 0)
    facts.push([`${Math.round(100 * Math.min(...batteries))} %`, "lowest battery"]);
  if (lost > 0) facts.push([String(lost), "without link"]);
  while (element.children.length > facts.length) element.lastChild?.remove();
  while (element.children.length < facts.length) element.append(h("p", {}, h("b"), h("span")));
  facts.forEach(([value, text], i) => {
    const [b, span] = element.children[i]?.children ?? [];
    if (b && span) {
      say(b, value);
      say(span, text);
    }
  });
}

/** Draws the segments of a bumper ring as bars, pressed ones marked. */
export function ring(element: HTMLElement, robot: Robot, side: "front" | "rear"): void {
  const segments = robot.bumpers.filter((bumper) => bumper.ring === side);
  while (element.children.length > segments.length) element.lastChild?.remove();
  while (element.children.length < segments.length) element.append(h("i"));
  segments.forEach((bumper, place) => {
    const bar = element.children[place];
    if (bar) mark(bar, "data-pressed", bumper.pressed);
  });
}

export function tiles(store: Store, link: Link, markAt: (column: number) => void): HTMLElement {
  const made = new Map<string, Tile>();
  const strip = h("div", { class: "tiles" });
  const toggle = button("Camera off", "camera", () => {
    const { robot } = store;
    if (robot?.camera) link.request({ type: "camera", robot: robot.name, on: !robot.camera.on });
  });
  const save = button("Save picture", "picture", () => savePicture(store));
  const named = (): void => {
    save.title = store.keys.of("picture");
  };
  named();
  store.on("bindings", named);
  const element = h(
    "section",
    { class: "panel cameras", "data-panel": "cameras", "aria-label": "Cameras" },
    h(
      "div",
      { class: "panel-head" },
      h("h2", {}, "Cameras"),
      h("div", { class: "tools" }, markButton(store), save, toggle),
    ),
    strip,
  );
  const team = h("div", { class: "team", "data-team": true });
  const none = emptyNote(store, (now) => newsText(store, now));
  strip.append(team, none);
  const arrange = (): void => {
    const side = Math.max(1, store.robots.length - 1);
    const few = [5, 4, 3].find((c) => side % c === 0) ?? Math.min(5, side);
    strip.style.setProperty("--few", String(Math.min(side, few)));
    const { clientWidth: width } = strip;
    const seen = element.closest("main")?.clientHeight ?? 0;
    if (width < 8 || seen < 8) return;
    const height = Math.max(rem(LEAST), 0.54 * seen - rem(HEAD));
    const { rows, columns, spare } = layout(store.robots.length, width, height);
    const cell = Math.min(width / columns, (height / rows) * (4 / 3));
    strip.style.setProperty("--rows", String(rows));
    strip.style.setProperty("--columns", String(columns));
    strip.style.setProperty("--cell", `${Math.floor(cell) - rem(GAP)}px`);
    mark(strip, "data-small", cell < rem(130));
    team.hidden = spare === 0 || store.robots.length === 0;
    team.style.gridArea = `${rows - spare + 1} / ${columns} / ${rows + 1} / ${columns + 1}`;
    teamText(team, store, spare * cell > rem(120));
  };
  new ResizeObserver(arrange).observe(strip);
  addEventListener("resize", arrange);

  const update = (): void => {
    const now = pageTime();
    const silent = isStale(store.ages.silence(now));
    const { robots } = store;
    for (const [name, tile] of made) {
      if (robots.some((robot) => robot.name === name)) continue;
      tile.element.remove();
      made.delete(name);
    }
    mark(strip, "data-count", String(robots.length));
    arrange();
    for (const robot of robots) {
      let tile = made.get(robot.name);
      if (!tile) {
        tile = new Tile(store, robot.name, markAt);
        made.set(robot.name, tile);
        team.before(tile.element);
      }
      const picture = store.slot(robot.index).picture;
      const age = picture
        ? store.ages.ofDatum(picture.time, robot.camera?.age ?? 0, now)
        : Number.POSITIVE_INFINITY;
      const waits = waitText(store, `picture of ${robot.name}`, now);
      tile.update(robot, age, robot.name === store.selected, silent, waits);
    }
    const camera = store.robot?.camera;
    toggle.disabled = !camera;
    save.disabled = !camera;
    say(toggle, camera && !camera.on ? "Camera on" : "Camera off");
  };
  store.on("state", update);
  store.on("select", update);
  const aim = (): void => {
    mark(element, "data-armed", store.armed);
    const { considered } = store;
    for (const robot of store.robots)
      made
        .get(robot.name)
        ?.aimAt(robot, considered?.robot === robot.name ? considered.place : null);
  };
  for (const topic of ["mark", "state"] as const) store.on(topic, aim);
  setInterval(() => {
    if (store.ages.silence(pageTime()) > 0.25) update();
  }, LOOK_MS);
  const fresh = new Set<number>();
  const draw = (): void => {
    for (const robot of store.robots) {
      const picture = fresh.has(robot.index) && store.slot(robot.index).picture;
      if (!picture) continue;
      made.get(robot.name)?.picture(picture.image);
      store.drawn.set(robot.name, store.ages.ofStamp(picture.time, pageTime()));
    }
    fresh.clear();
  };
  store.on("picture", (index) => {
    fresh.add(index as number);
    store.beat.ask(draw);
  });
  return element;
}

/** Hands the chosen robot's picture to the browser as a file. */
export function savePicture(store: Store): void {
  const { robot } = store;
  const image = robot && store.slot(robot.index).picture?.image;
  if (!robot || !image) {
    store.tell("notice", "there is no picture to save");
    return;
  }
  const canvas = h("canvas", { width: image.width, height: image.height });
  canvas.getContext("2d")?.drawImage(image, 0, 0);
  canvas.toBlob((blob) => {
    if (blob) save(blob, `${robot.name.replace(/\W/g, "_")}.png`);
  });
}

export function save(blob: Blob, name: string): void {
  const url = URL.createObjectURL(blob);
  h("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 1000);
}
