// Keys and pad: which does what, refused where two actions want the same, exported and imported as TOML.
// Pure. Keys are named as KeyboardEvent.code (the place on the keyboard, whatever its layout).

export const ACTIONS = {
  forward: "drive forward",
  back: "drive back",
  left: "turn left",
  right: "turn right",
  up: "climb (aircraft)",
  down: "sink (aircraft)",
  slow: "slow while held",
  faster: "driving speed up",
  slower: "driving speed down",
  turn_faster: "turning speed up",
  turn_slower: "turning speed down",
  estop: "emergency stop",
  mark: "mark a victim",
  mode: "operator or autonomous",
  picture: "save the picture",
  acknowledge: "acknowledge the first alarm",
  take: "take or hand back",
} as const;

export const PAD_ACTIONS = {
  dead_man: "drive while held",
  slow: "slow while held",
  connect: "connect, take the robot",
  laser: "laser on or off",
  robot_1: "choose robot 1",
  robot_2: "choose robot 2",
  robot_3: "choose robot 3",
  robot_4: "choose robot 4",
  estop_left: "emergency stop, first of two",
  estop_right: "emergency stop, second of two",
} as const;

export type Action = keyof typeof ACTIONS;
export type PadAction = keyof typeof PAD_ACTIONS;
export const AXES = ["turn", "forward", "side", "up"] as const;
export type Axis = (typeof AXES)[number];

export interface Bindings {
  keys: Record<Action, string[]>;
  buttons: Record<PadAction, number>;
  axes: Record<Axis, number>;
}

export class BindingError extends Error {}

export function defaults(): Bindings {
  return {
    keys: {
      forward: ["KeyW", "ArrowUp"],
      back: ["KeyS", "ArrowDown"],
      left: ["KeyA", "ArrowLeft"],
      right: ["KeyD", "ArrowRight"],
      up: ["PageUp"],
      down: ["PageDown"],
      slow: ["ShiftLeft", "ShiftRight"],
      faster: ["KeyR"],
      slower: ["KeyF"],
      turn_faster: ["KeyT"],
      turn_slower: ["KeyG"],
      estop: ["Space"],
      mark: ["KeyM"],
      mode: ["KeyO"],
      picture: ["KeyP"],
      acknowledge: ["KeyK"],
      take: ["KeyL"],
    },
    buttons: {
      dead_man: 5,
      slow: 4,
      connect: 9,
      laser: 8,
      robot_1: 0,
      robot_2: 1,
      robot_3: 2,
      robot_4: 3,
      estop_left: 10,
      estop_right: 11,
    },
    axes: { turn: 0, forward: 1, side: 2, up: 3 },
  };
}

/**
 * Throws BindingError, with both names, where two actions want one key, button or axis, or one that is fixed; `name` says
 * what a key is called there.
 */
export function check(bindings: Bindings, name: (code: string) => string = (code) => code): void {
  const keys = Object.entries(bindings.keys).flatMap(([action, codes]) =>
    codes.map((code): [string, string] => [code, ACTIONS[action as Action]]),
  );
  for (const [code, action] of keys) {
    if (/^Digit[0-9]$|^Escape$|^Tab$|^Enter$/.test(code))
      throw new BindingError(`${code} is fixed and cannot be "${action}"`);
    if (/^(Control|Alt|Meta|OS)(Left|Right)?$/.test(code))
      throw new BindingError(`${code} is the browser's and cannot be "${action}"`);
  }
  distinct(keys.map(([code, action]) => [name(code), action]));
  const buttons = Object.entries(bindings.buttons);
  distinct(buttons.map(([name, n]) => [`button ${n}`, PAD_ACTIONS[name as PadAction]]));
  distinct(Object.entries(bindings.axes).map(([name, n]) => [`axis ${n}`, name]));
}

function distinct(pairs: [string, string][]): void {
  const seen = new Map<string, string>();
  for (const [what, action] of pairs) {
    const other = seen.get(what);
    if (other !== undefined) throw new BindingError(`${what} is both "${other}" and "${action}"`);
    seen.set(what, action);
  }
}

export function toToml(bindings: Bindings): string {
  const rows = ["# Keys and pad of the usarsim console", "[keys]"];
  for (const [action, codes] of Object.entries(bindings.keys))
    rows.push(`${action} = [${codes.map((code) => JSON.stringify(code)).join(", ")}]`);
  for (const table of ["buttons", "axes"] as const) {
    rows.push("", `[${table}]`);
    for (const [name, number] of Object.entries(bindings[table])) rows.push(`${name} = ${number}`);
  }
  return `${rows.join("\n")}\n`;
}

/** Reads what toToml writes (tables, numbers, lists of texts); what a file leaves out keeps its default. */
export function fromToml(text: string): Bindings {
  const result = defaults();
  let table = "";
  text.split(/\r?\n/).forEach((row, index) => {
    const fail = (why: string): never => {
      throw new BindingError(`line ${index + 1}: ${why}`);
    };
    const line = row.replace(/^((?:[^"#]|"[^"]*")*)#.*$/, "$1").trim();
    if (line === "") return;
    const heading = /^\[(\w+)\]$/.exec(line);
    if (heading) {
      table = heading[1] ?? "";
      if (!["keys", "buttons", "axes"].includes(table)) fail(`there is no table [${table}]`);
      return;
    }
    const [, name = "", value = ""] = /^(\w+)\s*=\s*(.+)$/.exec(line) ?? fail("not NAME = VALUE");
    if (table === "") fail("stands before any [table]");
    const known: object = result[table as keyof Bindings];
    if (!Object.hasOwn(known, name)) fail(`[${table}] has no ${name}`);
    if (table === "keys") {
      if (!/^\[\s*("[A-Za-z0-9]+"\s*(,\s*"[A-Za-z0-9]+"\s*)*)?,?\s*\]$/.test(value))
        fail(`${name} must be a list of key codes such as ["KeyW"]`);
      result.keys[name as Action] = [...value.matchAll(/"([^"]+)"/g)].map((m) => m[1] ?? "");
    } else {
      if (!/^\d{1,2}$/.test(value)) fail(`${name} must be a number from 0 to 99`);
      (known as Record<string, number>)[name] = Number(value);
    }
  });
  check(result);
  return result;
}

/** A key's code for people: `KeyW` is W, `ArrowUp` is ↑. */
export function keyText(code: string): string {
  const arrows: Record<string, string> = {
    ArrowUp: "↑",
    ArrowDown: "↓",
    ArrowLeft: "←",
    ArrowRight: "→",
  };
  return arrows[code] ?? code.replace(/^(Key|Digit)/, "").replace(/^(Shift)(Left|Right)$/, "$1");
}
