// Puts the page together.

import { addressOf } from "./address";
import { acknowledgeFirst, alarmList, markList, notices, questions } from "./alarms";
import type { Action, Bindings } from "./bindings";
import { charts, linesButton } from "./charts";
import { choice, h, mark, say } from "./dom";
import { fragment, watchFragment } from "./fragment";
import { header } from "./header";
import { Input } from "./input";
import { keysDialog, savedBindings } from "./keys";
import { laser } from "./laser";
import { lines } from "./lines";
import { Link } from "./link";
import { MapView } from "./map";
import { markDialog } from "./marking";
import { readyBar } from "./ready";
import { remapDialog, savedPads } from "./remap";
import { robotCard, robotList, takeOrBack } from "./robots";
import { guessOfColumn, placeOfColumn } from "./sighting";
import { stopAll, stopBar } from "./stop";
import { Store } from "./store";
import { firstTheme } from "./theme";
import { savePicture, tiles } from "./tiles";
import { touchSticks } from "./touch";
import { View3D } from "./view3d";

function keysHint({ keys }: Store): string {
  const of = (...actions: Action[]): string => actions.map((one) => keys.of(one)).join(" ");
  const drive = of("forward", "left", "back", "right");
  return [
    `${/^(\S ){3}\S$/.test(drive) ? drive.replaceAll(" ", "") : drive} drive`,
    `${of("slow")} slow`,
    `${of("faster", "slower")} speed`,
    `${of("turn_faster", "turn_slower")} turn`,
    "1–9 robot",
    `${of("estop")} stop`,
    `${of("mark")} mark`,
    `${of("mode")} mode`,
    `${of("acknowledge")} alarm`,
    `${of("take")} take`,
  ].join(" · ");
}

const onlyHint = ({ keys }: Store, device: string): string =>
  `Only the ${device} drives here · ${keys.of("estop")} stop · ${keys.of("mark")} mark`;

const viewerHint = ({ keys }: Store): string => `1–9 robot · ${keys.of("picture")} save picture`;

function driveStrip(store: Store, input: Input): HTMLElement {
  const text = h("output", { "data-wish": true });
  const hint = h("span", { class: "quiet hint" });
  const explain = (): void => {
    const { role, device = "any" } = store.welcome ?? {};
    mark(hint, "data-only", device === "any" ? null : device);
    say(
      hint,
      role === "viewer"
        ? viewerHint(store)
        : device === "any"
          ? keysHint(store)
          : onlyHint(store, device),
    );
  };
  for (const topic of ["welcome", "bindings"] as const) store.on(topic, explain);
  explain();
  const element = h("footer", { class: "strip" }, text, hint);
  setInterval(() => {
    const { forward, turn, up } = input.wish;
    const arrow = (x: number): string => `${x < 0 ? "−" : "+"}${Math.abs(x).toFixed(1)}`;
    const limits = `speed ${Math.round(100 * input.keyboard.driving)} % · turn ${Math.round(100 * input.keyboard.turning)} %`;
    const lift = store.robot?.kind === "aerial" ? ` up ${arrow(up)}` : "";
    say(
      text,
      input.device ? `${input.device}: ${arrow(forward)} turn ${arrow(turn)}${lift}` : limits,
    );
    mark(element, "data-device", input.device ?? "none");
  }, 100);
  return element;
}

function start(): void {
  const { token, panel, theme, session } = addressOf(fragment());
  watchFragment();
  firstTheme(theme);
  const store = new Store();
  const link = new Link(store, token, localStorage.getItem("usarsim-name"));
  let bindings = savedBindings(session);
  store.keys.bindings = bindings;
  store.keys.watch();
  const padMaps = savedPads();
  const input = new Input(store, link, bindings, padMaps);
  const apply = (next: Bindings): void => {
    bindings = next;
    input.bind(next);
    store.keys.bindings = next;
    store.tell("bindings");
  };

  const markAhead = (column = 0): void => {
    const { robot } = store;
    if (!robot || store.welcome?.role === "viewer") return;
    const place = placeOfColumn(robot, column, store.slot(robot.index).scan);
    const guess = place ? null : guessOfColumn(robot, column);
    if (place) markDialog(store, link, { place });
    else if (guess) markDialog(store, link, { place: guess, guessed: true });
    else store.tell("notice", `${robot.name} tells no place: Mark, then click on the map`);
  };
  // What a key would ask for and the gateway refuse: a viewer is told once that it looks only.
  const acting = (act: () => void) => () => {
    if (store.welcome?.role === "viewer") store.tell("notice", "a viewer only looks");
    else act();
  };
  input.acts = {
    estop: acting(() => stopAll(link)),
    mark: acting(markAhead),
    picture: () => savePicture(store),
    acknowledge: acting(() => acknowledgeFirst(store, link)),
    take: acting(() => void takeOrBack(store, link)),
    mode: acting(() => void takeOrBack(store, link)),
    connect: () => {
      if (!store.connected) link.open();
      else if (!store.mine) input.acts.take?.();
    },
    laser: () => {
      const { robot } = store;
      if (robot?.laser) link.request({ type: "laser", robot: robot.name, on: !robot.laser.on });
    },
  };
  input.strangePad = (pad) => remapDialog(pad, padMaps);

  const map = new MapView(store, (place) => {
    if (store.welcome?.role !== "viewer") markDialog(store, link, { place });
  });
  const view = new View3D(store, link.token);
  const rows = lines(store, link);
  const opened = linesButton(store, (open) => {
    rows.open(open);
    mark(main, "data-lines-open", open);
  });
  const classic = panel === "classic";
  const shown = classic
    ? [laser(store, link), laser(store, link, "strips")]
    : [view.element, map.element];
  const beside = classic ? [] : [laser(store, link), charts(store, opened)];
  const main = h(
    "main",
    { class: "grid", "data-tab": "drive", "data-variant": panel },
    h(
      "div",
      { class: "column left" },
      robotList(store),
      alarmList(store, link),
      markList(store, link, (id) => markDialog(store, link, { id })),
    ),
    h(
      "div",
      { class: "column middle" },
      tiles(store, link, markAhead),
      h("div", { class: "pair" }, ...shown, rows.element),
    ),
    h("div", { class: "column right" }, robotCard(store, link), ...beside),
  );
  const tabs = choice(
    "panels",
    { drive: "Drive", world: "World", team: "Team", more: "More" },
    "drive",
    (tab) => {
      mark(main, "data-tab", tab);
    },
  );
  tabs.classList.add("tabs");
  document.body.append(
    header(store, link, () => keysDialog(store, session, bindings, apply)),
    h(
      "div",
      { class: "banners" },
      stopBar(store, link),
      readyBar(store, link, input),
      questions(store, link),
    ),
    tabs,
    main,
    touchSticks(store, input),
    driveStrip(store, input),
    notices(store),
  );
  store.on("select", () => link.send({ type: "select", robot: store.selected }));
  // For tests of the browser: what the page knows, and where its meshes are.
  Object.assign(window, {
    usarsim: {
      store,
      input,
      poseOf: (robot: string) => view.poseOf(robot),
      cloud: () => view.cloudDrawn(),
      eye: () => view.eye(),
      map,
    },
  });
  link.open();
}

start();
