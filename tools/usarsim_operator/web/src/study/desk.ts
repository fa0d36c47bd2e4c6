// The WebSocket to the desk: hello, a ping every second, connecting again, and answers until they are saved.

import { fragment, hideFragment, watchFragment } from "../fragment";
import { pageTime } from "../store";
import type { Overview, Refused, Step, Told, Value } from "./protocol";
import { Unsaved } from "./unsaved";

/** s without a word from the desk after which the connection is given up. */
const SILENCE_S = 6;
const FIRST_WAIT_S = 0.25;
const LONGEST_WAIT_S = 2;
/** The code of a close where all places are taken. */
const FULL = 1013;

export interface Hearer {
  step: (step: Step) => void;
  overview: (overview: Overview) => void;
  refused: (refused: Refused) => void;
  /** An order was carried out. */
  done: (deed: string) => void;
  /** Connected or not, and why not; how many answers are not saved yet. */
  link: () => void;
}

export class Desk {
  connected = false;
  why = "";
  step: Step | null = null;
  readonly unsaved = new Unsaved(
    window.sessionStorage,
    () => (performance.timeOrigin + performance.now()) / 1000,
  );
  private socket: WebSocket | null = null;
  private heard = 0;
  /** The first step of this connection is still to come. */
  private fresh = true;
  private wait = FIRST_WAIT_S;
  private readonly token = decodeURIComponent(fragment().slice(1));

  constructor(private readonly hearer: Hearer) {
    watchFragment();
    setInterval(() => this.beat(), 1000);
  }

  open(): void {
    if (this.token === "") {
      this.why = "no token: open the address that the desk printed, with all behind #";
      this.hearer.link();
      return;
    }
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/socket`);
    this.socket = socket;
    this.heard = pageTime();
    this.fresh = true;
    socket.onopen = () => socket.send(JSON.stringify({ type: "hello", token: this.token }));
    socket.onmessage = (event) => this.hear(JSON.parse(String(event.data)) as Told);
    socket.onclose = (event) => this.lost(socket, event);
  }

  private lost(socket: WebSocket, event: CloseEvent): void {
    if (socket !== this.socket) return;
    this.socket = null;
    this.connected = false;
    const refused = event.code === 1008 || event.code === FULL;
    this.why = refused ? event.reason || "the desk refused this page" : "";
    // Others take turns with this page: each of them gets some seconds.
    if (event.code === FULL) this.wait = Math.max(this.wait, 4);
    this.hearer.link();
    setTimeout(() => this.open(), 1000 * this.wait);
    this.wait = Math.min(this.why ? 30 : LONGEST_WAIT_S, 2 * this.wait);
  }

  /** Says that it lives, and gives up a connection that is silent: a new one is tried. */
  private beat(): void {
    const { socket } = this;
    if (socket === null) return;
    this.send({ type: "ping" });
    if (pageTime() - this.heard < SILENCE_S) return;
    socket.close();
    // The other end may never answer the close.
    this.lost(socket, new CloseEvent("close"));
  }

  private hear(told: Told): void {
    this.heard = pageTime();
    if (!this.connected && (told.type === "step" || told.type === "overview")) {
      this.connected = true;
      hideFragment();
      this.why = "";
      this.wait = FIRST_WAIT_S;
      this.arrived(told);
      this.hearer.link();
      return;
    }
    this.arrived(told);
  }

  private arrived(told: Told): void {
    switch (told.type) {
      case "step":
        this.stepped(told);
        break;
      case "overview":
        this.hearer.overview(told);
        break;
      case "saved":
        if (told.step !== this.step?.step) return;
        this.unsaved.saved(told.item);
        this.hearer.link();
        break;
      case "refused":
        if (told.item !== undefined) this.unsaved.saved(told.item);
        this.hearer.refused(told);
        break;
      case "done":
        this.hearer.done(told.do);
        break;
    }
  }

  /** Another step; or the same one again, over a new connection, with what the desk has of it. */
  private stepped(step: Step): void {
    this.step = step;
    if (step.kind !== "form") {
      this.unsaved.close();
    } else {
      // The number of a step is the same after a restart of the desk, and for each participant.
      this.unsaved.open(`${step.session ?? ""} ${step.step} ${step.form.form}`);
      if (this.fresh)
        for (const [item, given] of this.unsaved.reconnect()) this.sendAnswer(item, given);
      step.answers = this.unsaved.over(step.answers);
    }
    this.fresh = false;
    this.hearer.step(step);
  }

  /** Sends a text of the present step; false where there is no connection. */
  say(type: string, fields: Record<string, unknown> = {}): boolean {
    if (this.step === null) return false;
    return this.send({ type, step: this.step.step, ...fields });
  }

  /** An answer: sent at once, or as soon as the desk is back. */
  answer(item: string, value: Value | null): void {
    this.sendAnswer(item, this.unsaved.give(item, value));
    this.hearer.link();
  }

  private sendAnswer(item: string, given: { value: Value | null; clock: number }): void {
    if (this.say("answer", { item, ...given })) this.unsaved.sending(item);
  }

  order(deed: string, fields: Record<string, unknown> = {}): boolean {
    return this.send({ type: "order", do: deed, ...fields });
  }

  private send(text: { type: string; [key: string]: unknown }): boolean {
    if (this.socket?.readyState !== WebSocket.OPEN || !this.connected) return false;
    this.socket.send(JSON.stringify(text));
    return true;
  }
}
