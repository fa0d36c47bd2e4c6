// One input state, built 60 times a second by a timer (never by animation frames, which software GL makes
// slow), from keyboard, pad and touch; it becomes drive texts at the pace of mixing.ts. A key that starts or
// ends a drive is sent from its own event, without waiting for the timer. What only may have let go of a key counts as
// letting go: a key that is held for ever drives for ever.

import type { Action, Bindings, PadAction } from "./bindings";
import { codeOf, Keyboard } from "./keyboard";
import type { Link } from "./link";
import {
  Arbiter,
  allowed,
  type Device,
  isNeutral,
  NEUTRAL,
  Pacer,
  type Wish,
  wheels,
} from "./mixing";
import { Pad, type PadMaps } from "./pad";
import type { Robot } from "./protocol";
import { pageTime, type Store } from "./store";

const POLL_MS = 1000 / 60;
/** A page that did not run for so long, s, slept or hung: which keys are still down is not known. */
const ASLEEP_S = 2;

/** Keys that make commands of others; while one is down, and on Macs after it, the ways up of others are not told. */
const COMMANDS = ["Control", "Alt", "AltGraph", "Meta", "OS"];

/** Fields that take letters. */
const LETTERS = ["text", "search", "email", "url", "tel", "password"];
/** Keys that such a field uses and that write nothing. */
const EDITING = /^(Arrow|Page|Home|End|Enter|Tab|Backspace|Delete|Insert|Shift)/;
/** Keys that work a slider or a list; a number takes all keys. */
const WORKING = /^(Arrow|Page|Home|End|Enter|Escape|Tab|Digit|Numpad)/;

/** A page that frames this one passes on the keys that are pressed beside the frame. */
export interface PassedKey {
  type: "usarsim-key";
  code: string;
  key: string;
  down: boolean;
  repeat: boolean;
}

function takesLetters(target: EventTarget | null): boolean {
  if (target instanceof HTMLInputElement) return LETTERS.includes(target.type);
  if (target instanceof HTMLTextAreaElement) return true;
  return target instanceof HTMLElement && target.isContentEditable;
}

/** Whether a field has a use of its own for a key. */
function uses(target: EventTarget | null, code: string): boolean {
  if (takesLetters(target)) return true;
  if (target instanceof HTMLSelectElement) return WORKING.test(code);
  if (!(target instanceof HTMLInputElement)) return false;
  return target.type === "number" || WORKING.test(code);
}

export class Input {
  readonly keyboard: Keyboard;
  readonly pad: Pad;
  touch: Wish = NEUTRAL;
  wish: Wish = NEUTRAL;
  /** A button of a pad whose layout is known was pressed, and that pad is still there. */
  padAnswered = false;
  device: Device | null = null;
  padName = "";
  acts: Partial<Record<Action | PadAction, () => void>> = {};
  /** Told of a pad that has neither the standard layout nor a map of its own. */
  strangePad: (pad: Gamepad) => void = () => {};
  private readonly arbiter = new Arbiter();
  private readonly pacer = new Pacer();
  private focused = true;
  private driven = "";
  private lastDevice: Device = "keyboard";
  /** After a stop, a dialog or another choice under way: nothing drives before all devices were neutral. */
  private waits = false;
  /** Why driving was refused; said once, until the devices are neutral. */
  private refused = false;
  /** When the devices were read last: on the clock of the page, and on that of the day, which goes on in sleep. */
  private ran = { page: pageTime(), day: Date.now() / 1000 };
  /** Pads without a known layout that were offered to be set up. */
  private readonly offered = new Set<string>();

  private get busy(): boolean {
    return !this.focused || document.querySelector("dialog[open]") !== null;
  }

  constructor(
    private readonly store: Store,
    private readonly link: Link,
    bindings: Bindings,
    padMaps: PadMaps,
  ) {
    this.keyboard = new Keyboard(bindings);
    this.pad = new Pad(bindings, padMaps);
    // The stops come before anything on the page gets the key.
    addEventListener("keydown", (event) => this.stops(event, true), true);
    addEventListener("keyup", (event) => this.stops(event, false), true);
    addEventListener("keydown", (event) => this.key(event));
    addEventListener("keyup", (event) => {
      if (COMMANDS.includes(event.key)) this.keyboard.release();
      this.keyboard.up(codeOf(event));
      this.tick();
    });
    addEventListener("message", (event) => {
      const passed = event.data as PassedKey | null;
      if (event.source === window.parent && passed?.type === "usarsim-key") this.passed(passed);
    });
    // What takes the keyboard without the window losing its focus: menus, things that are dragged, input methods.
    for (const taken of ["contextmenu", "dragstart", "compositionstart", "beforeprint", "freeze"])
      addEventListener(taken, () => this.forget(), true);
    addEventListener("pagehide", () => this.forget());
    addEventListener("focusin", ({ target }) => {
      if (takesLetters(target) || target instanceof HTMLSelectElement) this.forget();
    });
    addEventListener("blur", () => this.release(false));
    addEventListener("focus", () => {
      this.focused = true;
    });
    document.addEventListener("visibilitychange", () => this.release(!document.hidden));
    addEventListener("gamepadconnected", (event) => {
      const { gamepad } = event;
      store.tell("notice", `pad connected: ${gamepad.id}`);
      this.offered.delete(gamepad.id);
      if (this.pad.knows(gamepad)) this.knownPad();
      else this.offer(gamepad);
    });
    addEventListener("gamepaddisconnected", () => this.tick());
    setInterval(() => this.tick(), POLL_MS);
    store.on("select", () => this.tick());
  }

  bind(bindings: Bindings): void {
    this.keyboard.release();
    this.keyboard.bindings = bindings;
    this.pad.bindings = bindings;
  }

  /** Nothing is known to be held any more; what is has to be pressed again. */
  forget(): void {
    this.keyboard.release();
    this.tick();
  }

  private padLost(): void {
    if (this.padName === "") return;
    this.padName = "";
    this.padAnswered = false;
    this.store.tell("notice", "the pad is gone: what it drove stops");
  }

  /** Nothing is held any more: focus is lost, the page hidden, or a dialog open. */
  release(focused: boolean): void {
    this.focused = focused;
    this.keyboard.release();
    this.touch = NEUTRAL;
    this.tick();
  }

  private get mayStop(): boolean {
    return this.store.welcome?.role !== "viewer";
  }

  /**
   * The emergency stop's key, wherever the focus is but in a field that takes letters, and Esc twice, wherever it is.
   * Ctrl, Alt and Command make commands of letters, of other keys nothing that matters more.
   */
  private stops(event: KeyboardEvent, down: boolean): void {
    const code = codeOf(event);
    const pressed = this.keyboard.pressed(code, down, event.repeat);
    // When it was pressed, not when a busy page heard of it.
    if (code === "Escape") {
      if (pressed && this.keyboard.escape(event.timeStamp / 1000)) this.acts.estop?.();
      return;
    }
    const { target, key } = event;
    if (this.keyboard.action(code) !== "estop" || !this.mayStop) return;
    if (target instanceof HTMLElement && target.hasAttribute("data-listens")) return;
    const letter = [...key].length === 1;
    if (takesLetters(target) && (letter || EDITING.test(code) || event.isComposing)) return;
    if (letter && key !== " " && (event.ctrlKey || event.altKey || event.metaKey)) return;
    // Nothing else gets it: a button would be pressed, a list opened, the page scrolled.
    event.preventDefault();
    event.stopPropagation();
    if (pressed) this.stop();
  }

  private passed({ code, key, down, repeat }: PassedKey): void {
    const found = codeOf({ code, key });
    const pressed = this.keyboard.pressed(found, down, repeat);
    if (!pressed) return;
    if (found === "Escape" && this.keyboard.escape(pageTime())) this.acts.estop?.();
    if (this.keyboard.action(found) === "estop" && this.mayStop) this.stop();
  }

  private stop(): void {
    this.acts.estop?.();
    this.tick();
  }

  private key(event: KeyboardEvent): void {
    const { target, key } = event;
    const code = codeOf(event);
    if (event.ctrlKey || event.altKey || event.metaKey || COMMANDS.includes(key)) {
      this.forget();
      return;
    }
    // The stops were heard above; a viewer's Space is the browser's.
    if (code === "Escape" || this.keyboard.action(code) === "estop" || event.isComposing) return;
    if (key === "Enter" && target instanceof HTMLInputElement && target.type === "checkbox")
      target.click();
    if (document.querySelector("dialog[open]") || uses(target, code)) return;
    this.focused = true;
    const digit = /^Digit([0-9])$/.exec(code)?.[1];
    if (digit !== undefined) {
      const place = digit === "0" ? 9 : Number(digit) - 1;
      this.choose(place);
      return;
    }
    const action = this.keyboard.down(code, event.repeat);
    // The arrows would scroll.
    if (this.keyboard.action(code) !== null) event.preventDefault();
    if (action !== null) this.acts[action]?.();
    this.tick();
  }

  private choose(place: number): void {
    const robot = this.store.robots[place];
    if (robot) this.store.select(robot.name);
  }

  /**
   * Reads the pads. One drives: its layout is known. The emergency stop of each such pad works, also while the page is
   * busy with something else.
   */
  private padWish(free: boolean): Wish {
    const pads = [...(navigator.getGamepads?.() ?? [])].filter((p) => p?.connected) as Gamepad[];
    const pad = this.pad.choose(pads);
    for (const one of pads) {
      const presses = this.pad.presses(one);
      if (!this.pad.knows(one)) {
        if (this.pad.touched(one)) this.offer(one);
        continue;
      }
      for (const press of presses)
        if (press === "estop_left" || (free && one === pad)) this.padAct(press);
    }
    if (!pad) {
      this.padLost();
      return NEUTRAL;
    }
    if (this.padName !== "" && this.padName !== pad.id && !pads.some((p) => p.id === this.padName))
      this.padLost();
    this.padName = pad.id;
    if (pad.buttons.some((button) => button.pressed)) this.padAnswered = true;
    return this.pad.wish(pad);
  }

  /** A pad whose layout is not known is asked for it, unless there is another pad that drives. */
  private offer(pad: Gamepad): void {
    const pads = [...(navigator.getGamepads?.() ?? [])];
    if (this.offered.has(pad.id) || pads.some((p) => p?.connected && this.pad.knows(p))) return;
    if (this.busy || this.driven !== "") return;
    this.offered.add(pad.id);
    this.strangePad(pad);
  }

  /** A pad that drives has come: what was asked about another one, and not answered yet, is not needed. */
  private knownPad(): void {
    document.querySelector<HTMLDialogElement>("dialog[data-remap][data-step='0']")?.close("no");
  }

  private padAct(press: PadAction): void {
    const number = /^robot_(\d)$/.exec(press)?.[1];
    if (number !== undefined) this.choose(Number(number) - 1);
    if (press === "estop_left") this.acts.estop?.();
    if (press === "connect" || press === "laser") this.acts[press]?.();
  }

  /** One step: reads the devices, chooses one, sends what is due. */
  tick(): void {
    const now = pageTime();
    const day = Date.now() / 1000;
    const slept = Math.max(now - this.ran.page, day - this.ran.day) > ASLEEP_S;
    this.ran = { page: now, day };
    const free = !this.busy;
    if (!free || slept || !document.hasFocus()) this.keyboard.release();
    const { robot } = this.store;
    // What only aircraft can do is no wish of others.
    const fit = (wish: Wish): Wish =>
      robot?.kind === "aerial" ? wish : { ...wish, up: 0, side: 0 };
    const pad = fit(this.padWish(free));
    const all = { keyboard: fit(this.keyboard.wish()), pad, touch: fit(this.touch) };
    if (Object.values(all).every(isNeutral)) this.waits = this.refused = false;
    const only = this.store.welcome?.device;
    const { wishes, refused } = allowed(all, only);
    if (refused) this.refuse(`only the ${only} drives here`);
    const another = this.driven !== "" && this.driven !== robot?.name;
    if (this.driven !== "" && (another || !free)) this.waits = true;
    if (another) this.stopDriven(now);
    this.wish = free && !this.waits ? this.arbiter.choose(wishes, now) : NEUTRAL;
    this.device = free && !this.waits ? this.arbiter.device : null;
    if (this.device !== null) this.lastDevice = this.device;
    if (!robot || this.store.welcome?.role === "viewer") return;
    if (!isNeutral(this.wish) && this.mayNot(robot)) {
      if (this.driven === "") return;
      this.stopDriven(now);
      this.waits = true;
      return;
    }
    if (!this.pacer.due(this.wish, now)) return;
    if (!isNeutral(this.wish) && robot.holder === null && this.driven === "")
      this.link.request({ type: "take", robot: robot.name });
    this.driven = isNeutral(this.wish) ? "" : robot.name;
    this.link.send(driveText(robot, this.wish, this.lastDevice));
  }

  /** Whether a drive could only be refused; says why once for as long as something is held. */
  private mayNot(robot: Robot): boolean {
    const { holder } = robot;
    const stop = this.store.state?.estop;
    const why = stop
      ? `stopped by ${stop.by}: release the stop first`
      : isOthers(this.store, robot)
        ? `${robot.name} is for operator ${robot.seat} to drive`
        : robot.failed
          ? `${robot.name} has failed`
          : !robot.enabled
            ? `${robot.name} is disabled: enable it first`
            : holder && holder.page !== this.store.welcome?.page
              ? `${holder.name} drives ${robot.name}: ask for it`
              : "";
    if (why === "") this.refused = false;
    else this.refuse(why);
    return why !== "";
  }

  /** Says why nothing drives, once. */
  private refuse(why: string): void {
    if (!this.refused) this.store.tell("notice", why);
    this.refused = true;
  }

  private stopDriven(now: number): void {
    const before = this.store.robots.find((r) => r.name === this.driven);
    this.driven = "";
    this.pacer.due(NEUTRAL, now);
    if (before) this.link.send(driveText(before, NEUTRAL, this.lastDevice));
  }
}

/** Whether a robot of a trial is another operator's. */
export function isOthers({ welcome }: Store, { seat }: Pick<Robot, "seat">): boolean {
  return !!welcome?.seat && typeof seat === "number" && seat !== welcome.seat;
}

/** The drive text of a wish, by what the robot is. */
export function driveText(robot: Pick<Robot, "name" | "kind">, wish: Wish, device: Device) {
  const whom = { robot: robot.name, device };
  if (robot.kind === "aerial") {
    const { up: altitude, forward: linear, side: lateral, turn: rotational } = wish;
    return { type: "fly", ...whom, altitude, linear, lateral, rotational };
  }
  if (robot.kind === "car" || robot.kind === "underwater")
    return { type: "steer", ...whom, speed: wish.forward, steer: wish.turn };
  return { type: "drive", ...whom, ...wheels(wish) };
}
