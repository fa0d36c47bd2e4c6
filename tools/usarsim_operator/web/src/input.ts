// One input state, built 60 times a second by a timer (never by animation frames, which software GL makes
// slow), from keyboard, pad and touch; it becomes drive texts at the pace of mixing.ts. A key that starts or
// ends a drive is sent from its own event, without waiting for the timer.

import type { Action, Bindings, PadAction } from "./bindings";
import { Keyboard } from "./keyboard";
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

export class Input {
  readonly keyboard: Keyboard;
  readonly pad: Pad;
  touch: Wish = NEUTRAL;
  wish: Wish = NEUTRAL;
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
    addEventListener("keydown", (event) => this.key(event));
    addEventListener("keyup", (event) => {
      this.keyboard.up(event.code);
      this.tick();
    });
    addEventListener("blur", () => this.release(false));
    addEventListener("focus", () => {
      this.focused = true;
    });
    document.addEventListener("visibilitychange", () => this.release(!document.hidden));
    addEventListener("gamepadconnected", (event) => {
      this.padName = event.gamepad.id;
      store.tell("notice", `pad connected: ${event.gamepad.id}`);
      if (!this.pad.knows(event.gamepad)) this.strangePad(event.gamepad);
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

  private padLost(): void {
    if (this.padName === "") return;
    this.padName = "";
    this.pad.lost();
    this.store.tell("notice", "the pad is gone: what it drove stops");
  }

  /** Nothing is held any more: focus is lost, the page hidden, or a dialog open. */
  release(focused: boolean): void {
    this.focused = focused;
    this.keyboard.release();
    this.touch = NEUTRAL;
    this.tick();
  }

  private key(event: KeyboardEvent): void {
    const { target } = event;
    const typing = target instanceof HTMLInputElement || target instanceof HTMLTextAreaElement;
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const stops = event.code === "Escape";
    if (
      (document.querySelector("dialog[open]") || typing || target instanceof HTMLSelectElement) &&
      !stops
    )
      return;
    this.focused = true;
    const digit = /^Digit([0-9])$/.exec(event.code)?.[1];
    if (digit !== undefined) {
      const place = digit === "0" ? 9 : Number(digit) - 1;
      this.choose(place);
      return;
    }
    // When it was pressed, not when a busy page heard of it: Esc twice must stop all the same.
    const action = this.keyboard.down(event.code, event.timeStamp / 1000, event.repeat);
    // Space would press the focused button, the arrows would scroll.
    if (this.keyboard.action(event.code) !== null) event.preventDefault();
    if (action !== null) this.acts[action]?.();
    this.tick();
  }

  private choose(place: number): void {
    const robot = this.store.robots[place];
    if (robot) this.store.select(robot.name);
  }

  /** Reads the pad; while the page is busy with something else its emergency stop still works. */
  private padWish(free: boolean): Wish {
    const pads = [...(navigator.getGamepads?.() ?? [])].filter((p) => p?.connected);
    const pad = pads[0];
    if (!pad) {
      this.padLost();
      return NEUTRAL;
    }
    this.padName = pad.id;
    for (const press of this.pad.presses(pad))
      if (free || press === "estop_left") this.padAct(press);
    return this.pad.wish(pad);
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
    const free = !this.busy;
    if (!free) this.keyboard.release();
    const { robot } = this.store;
    // What only aircraft can do is no wish of others.
    const fit = (wish: Wish): Wish =>
      robot?.kind === "aerial" ? wish : { ...wish, up: 0, side: 0 };
    const pad = fit(this.padWish(free));
    const all = { keyboard: fit(this.keyboard.wish()), pad, touch: fit(this.touch) };
    if (Object.values(all).every(isNeutral)) this.waits = this.refused = false;
    const only = this.store.welcome?.device;
    const { wishes, refused } = allowed(all, only);
    if (refused) this.refuse(`only the ${only} drives in this trial`);
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
