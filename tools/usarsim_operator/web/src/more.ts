// What an operator needs now and then, behind one disclosure of the chosen robot's card: moves of a given size, the
// camera's pose, flippers, and robots that come and go.

import { button, h, mark, say } from "./dom";
import { instructing } from "./instructor";
import type { Link } from "./link";
import { follow, listbox } from "./listbox";
import type { Robot } from "./protocol";
import { pageTime, type Store } from "./store";

const CLASSES =
  "P3AT P2AT P2DX P3DX ATRVJr Zerg Talon Kenaf TeleMax Tarantula Rugbot AirRobot Hummer Sedan Submarine Nao";
/** Joints of a robot that get a slider; legged machines have more than a hand can move. */
const MOST_JOINTS = 8;
/** What is asked for of robots that others drive, too. */
const NEEDS_NO_LOCK = ["remove", "policy"];
/** s between two texts of a slider that moves. */
const OFTEN_S = 0.1;

/** Flippers and other joints of a ground robot, rad by name, as its status told them. */
export function flippersOf(robot: Pick<Robot, "kind" | "joints">): [string, number][] {
  const joints = robot.kind === "ground" ? Object.entries(robot.joints ?? {}) : [];
  return joints.length > MOST_JOINTS ? [] : joints;
}

const degreesOf = (angle: number): number => Math.round((angle * 180) / Math.PI);
const rad = (degrees: number): number => (degrees * Math.PI) / 180;

export function more(store: Store, link: Link): HTMLElement {
  // A free robot is taken by what moves it, as by its first drive.
  const ask: Ask = async (text) => {
    const { robot } = store;
    if (!robot) return;
    const whom = { robot: robot.name };
    const free = robot.holder === null && !NEEDS_NO_LOCK.includes(text.type);
    if (!free || (await link.request({ type: "take", ...whom })))
      link.request({ ...text, ...whom });
  };
  const moves = moveRows(ask);
  const camera = row("Camera", []);
  const alone = row("Alone", [policyChoice(store, ask)]);
  const flippers = row("Flippers", []);
  const remove = removeButton(store, ask);
  const joining = row("Robots", [joinForm(store, link), remove]);
  const element = h(
    "details",
    { class: "more", "data-more": true },
    h("summary", {}, "More"),
    ...moves,
    alone,
    camera,
    flippers,
    joining,
    ...instructing(store, link),
  );
  let shown = "";
  const update = (): void => {
    const { robot } = store;
    element.hidden = store.welcome?.role === "viewer";
    const ground = robot?.kind === "ground";
    for (const one of moves) one.hidden = !ground;
    camera.hidden = !robot?.camera;
    alone.hidden = !robot?.own || !(ground || robot.kind === "car");
    remove.hidden = !robot?.own;
    const joints = robot ? flippersOf(robot) : [];
    const turns = Object.keys(robot?.camera?.turned ?? {});
    const key = [robot?.name, !robot?.camera, ...turns, ...joints.map(([name]) => name)].join(" ");
    if (key === shown) return;
    shown = key;
    camera.lastElementChild?.replaceChildren(...(robot ? cameraTools(ask, robot) : []));
    flippers.hidden = joints.length === 0;
    const angles: Record<string, number> = {};
    flippers.lastElementChild?.replaceChildren(
      ...joints.map(([name, angle]) =>
        slider(name.replace("Flipper", ""), -90, 90, degreesOf(angle), (degrees) => {
          angles[name] = rad(degrees);
          ask({ type: "flippers", angles });
        }),
      ),
    );
  };
  for (const topic of ["state", "select", "welcome"] as const) store.on(topic, update);
  return element;
}

export function row(label: string, tools: HTMLElement[]): HTMLElement {
  return h(
    "div",
    { class: "more-row", role: "group", "aria-label": label },
    h("span", { class: "quiet" }, label),
    h("div", { class: "more-tools" }, ...tools),
  );
}

type Ask = (text: { type: string; [key: string]: unknown }) => void;

function number(label: string, value: number, most: number, unit: string): HTMLInputElement {
  const title = `${label}, ${unit}`;
  return h("input", {
    type: "number",
    min: 0,
    max: most,
    step: "any",
    value,
    title,
    "aria-label": title,
  });
}

function moveRows(ask: Ask): HTMLElement[] {
  const angle = number("angle", 90, 3600, "degrees");
  const way = number("distance", 1, 1000, "m");
  const turn = (sign: number) => () => ask({ type: "rotate", degrees: sign * Number(angle.value) });
  const go = (sign: number) => () => ask({ type: "travel", metres: sign * Number(way.value) });
  const left = button("↶ left", "rotate-left", turn(-1));
  const right = button("↷ right", "rotate-right", turn(1));
  const ahead = button("↑ ahead", "travel-ahead", go(1));
  const back = button("↓ back", "travel-back", go(-1));
  return [
    row("Turn", [angle, h("span", { class: "unit" }, "°"), left, right]),
    row("Drive", [way, h("span", { class: "unit" }, "m"), ahead, back]),
  ];
}

const POLICIES = {
  stop: "stands",
  hold: "holds its heading",
  patrol: "patrols its way so far",
  explore: "explores",
};

/** What the robot does while nobody drives it. */
function policyChoice(store: Store, ask: Ask): HTMLElement {
  const label = "while nobody drives it";
  const attributes = { "data-do": "policy", "aria-label": label, title: label };
  const select = listbox(attributes, Object.entries(POLICIES));
  select.addEventListener("change", () => ask({ type: "policy", policy: select.value }));
  const update = (): void => {
    const policy = store.robot?.policy ?? "stop";
    const known = [...select.options].some((option) => option.value === policy);
    if (!known) select.append(h("option", { value: policy }, policy));
    follow(select, policy);
  };
  for (const topic of ["state", "select"] as const) store.on(topic, update);
  return select;
}

/** Sliders for what the camera can do, as it stands now; all of them where nobody knows that. */
function cameraTools(ask: Ask, { camera }: Robot): HTMLElement[] {
  if (!camera) return [];
  const { pan, tilt } = camera.turned ?? { pan: 0, tilt: 0 };
  const tool = (label: string, field: string, least: number, most: number, angle: number) =>
    slider(label, least, most, degreesOf(angle), (degrees) => {
      ask({ type: "camera_pose", [field]: rad(degrees) });
    });
  return [
    ...(pan === undefined ? [] : [tool("pan", "pan", -180, 180, pan)]),
    ...(tilt === undefined ? [] : [tool("tilt", "tilt", -90, 90, tilt)]),
    tool("field of view", "zoom", 10, 120, camera.fov ?? rad(60)),
  ];
}

/** A slider of degrees that tells its value while it moves, ten times a second at most, and at the end. */
function slider(
  label: string,
  least: number,
  most: number,
  first: number,
  moved: (degrees: number) => void,
): HTMLElement {
  const input = h("input", { type: "range", min: least, max: most, value: first, step: 1 });
  const value = h("output", { class: "number" }, `${first}°`);
  let last = 0;
  const tell = (): void => {
    last = pageTime();
    moved(Number(input.value));
  };
  input.addEventListener("input", () => {
    say(value, `${input.value}°`);
    if (pageTime() - last > OFTEN_S) tell();
  });
  input.addEventListener("change", tell);
  return h("label", { class: "slider" }, h("span", {}, label), input, value);
}

function joinForm(store: Store, link: Link): HTMLElement {
  const text = (label: string, most: number, attributes = {}): HTMLInputElement =>
    h("input", {
      type: "text",
      placeholder: label,
      "aria-label": label,
      maxlength: most,
      ...attributes,
    });
  const kind = text("class", 80, { value: "P3AT", list: "classes", required: true });
  const name = text("name", 80);
  const start = text("start", 80, { title: "name of a start pose; empty: the next one" });
  const classes = h(
    "datalist",
    { id: "classes" },
    ...CLASSES.split(" ").map((value) => h("option", { value })),
  );
  const add = h("button", { type: "submit", "data-do": "spawn" }, "Add");
  const form = h("form", { class: "join" }, kind, name, start, add, classes);
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    add.disabled = true;
    const wanted = {
      ...(name.value.trim() && { name: name.value.trim() }),
      ...(start.value.trim() && { start: start.value.trim() }),
    };
    const done = await link.request({ type: "spawn", class: kind.value.trim(), ...wanted });
    add.disabled = false;
    if (!done) return;
    store.tell("notice", `${wanted.name ?? kind.value.trim()} has come`);
    name.value = "";
    start.value = "";
  });
  return form;
}

/** Makes the button that removes the chosen robot. It asks first, for three seconds, about that robot only. */
function removeButton(store: Store, ask: Ask): HTMLButtonElement {
  let asked: string | undefined;
  let timer: number | undefined;
  const forget = (): void => {
    window.clearTimeout(timer);
    asked = undefined;
    say(b, "Remove this one");
    mark(b, "data-sure", false);
  };
  const b = button("Remove this one", "remove", () => {
    const yes = asked === store.selected;
    forget();
    if (yes) {
      ask({ type: "remove" });
      return;
    }
    asked = store.selected;
    say(b, `Remove ${asked}?`);
    mark(b, "data-sure", true);
    timer = window.setTimeout(forget, 3000);
  });
  store.on("select", forget);
  return b;
}
