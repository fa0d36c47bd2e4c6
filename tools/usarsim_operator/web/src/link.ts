// The WebSocket to the gateway: hello, heartbeat, requests with answers, and connecting again.

import { hideFragment } from "./fragment";
import { graphics } from "./gl";
import { decode, type Text, type Welcome } from "./protocol";
import { pageTime, type Store } from "./store";

export interface Answer {
  ok: boolean;
  why?: string;
}

const PICTURE = 1;
/** The code of a close where all places are taken. */
const FULL = 1013;
const ANSWER_WITHIN_MS = 5000;
/** `take` may wait for a person, whom the gateway gives 10 s. */
const TAKE_WITHIN_MS = 12_000;

export class Link {
  private socket: WebSocket | null = null;
  private nextId = 1;
  private wait = 0.25;
  private again = 0;
  /** The last ping that came back: what it said, and how long it took, s. */
  private round: { answered?: number; round?: number } = {};
  /** Pictures of this connection that are done with, and those that the gateway was told. */
  private shown = 0;
  private told = 0;
  private readonly pending = new Map<number, (answer: Answer) => void>();

  constructor(
    private readonly store: Store,
    readonly token: string,
    private given: string | null,
  ) {
    setInterval(() => this.ping(), 1000);
  }

  /** Whether somebody said who this is. */
  get named(): boolean {
    return !!this.given;
  }

  get name(): string {
    return this.given || (this.store.welcome?.name ?? "");
  }

  /** Says hello once more, by another name: what this page held is free then. */
  rename(name: string): void {
    this.given = name;
    this.wait = 0.05;
    this.socket?.close();
  }

  /** Connects, at once where the page waits to try again. */
  open(): void {
    if (this.socket) return;
    clearTimeout(this.again);
    if (this.token === "") {
      this.store.refused = "no token: open the address that the console printed, with all behind #";
      this.store.tell("link");
      return;
    }
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/socket`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.shown = this.told = 0;
      const token = this.token;
      const name = this.given || undefined;
      // Who cannot draw the world itself is sent a picture of it.
      const { webgl } = graphics();
      socket.send(
        JSON.stringify({
          type: "hello",
          token,
          name,
          clock: pageTime(),
          webgl,
          shown: true,
          ready: true,
        }),
      );
    };
    socket.onmessage = (event) => this.heard(event.data, socket);
    socket.onclose = (event) => {
      this.socket = null;
      this.store.connected = false;
      this.store.refused =
        event.code === 1008 || event.code === FULL
          ? event.reason || "the gateway refused this page"
          : "";
      // Others take turns with this page: each of them gets some seconds.
      if (event.code === FULL) this.wait = Math.max(this.wait, 4);
      for (const settle of this.pending.values()) settle({ ok: false, why: "the link is lost" });
      this.pending.clear();
      this.store.tell("link");
      this.again = window.setTimeout(() => this.open(), 1000 * this.wait);
      this.wait = Math.min(this.store.refused ? 30 : 4, 2 * this.wait);
    };
    this.socket = socket;
  }

  private heard(data: string | ArrayBuffer, socket: WebSocket): void {
    if (typeof data !== "string") {
      let message: ReturnType<typeof decode>;
      const picture = new Uint8Array(data, 0, 1)[0] === PICTURE;
      try {
        message = decode(data);
      } catch (error) {
        console.warn("a binary message was not understood:", error);
        if (picture) this.drawn(socket);
        return;
      }
      this.store
        .binary(message)
        .catch((error: unknown) => console.warn("a message was not shown:", error))
        .finally(() => picture && this.drawn(socket));
      return;
    }
    const text = JSON.parse(data) as Text;
    const { store } = this;
    switch (text.type) {
      case "welcome":
        hideFragment();
        this.welcomed(text);
        break;
      case "pong":
        store.rtt = pageTime() - text.clock;
        store.rounds.add(store.rtt);
        this.round = { answered: text.clock, round: store.rtt };
        break;
      case "state":
        store.heard(text);
        break;
      case "lines":
        store.addLines(text.robot, text.rows, text.lost ?? 0);
        break;
      case "answer":
        if (text.id === null && text.ok) this.tellWhy(text);
        else if (text.id !== null) {
          this.pending.get(text.id)?.(text);
          this.pending.delete(text.id);
        }
        break;
      case "event":
      case "asked":
        store.tell(text.type, text);
        break;
    }
  }

  /** A picture is drawn with the next beat, or never; the gateway sends the next one then. */
  private drawn(socket: WebSocket): void {
    if (socket !== this.socket) return;
    this.shown++;
    this.store.beat.ask(this.tellShown);
  }

  private readonly tellShown = (): void => {
    if (this.told === this.shown) return;
    this.told = this.shown;
    this.send({ type: "shown", count: this.shown });
  };

  private welcomed(welcome: Welcome): void {
    this.store.welcome = welcome;
    this.store.welcomed = pageTime();
    this.store.connected = true;
    this.store.rounds.clear();
    this.store.losses.clear();
    this.round = {};
    this.wait = 0.25;
    this.store.tell("welcome");
    this.store.tell("link");
    if (this.store.selected !== "") this.send({ type: "select", robot: this.store.selected });
  }

  private ping(): void {
    const { drawn } = this.store;
    const ages = Object.fromEntries(
      [...drawn].map(([name, age]) => [name, Number(age.toFixed(4))]),
    );
    drawn.clear();
    this.send({ type: "ping", ...this.round, ...(Object.keys(ages).length > 0 && { ages }) });
  }

  /** Sends a text with the page's clock; false where there is no link (or none that takes it). */
  send(text: { type: string; [key: string]: unknown }): boolean {
    if (this.socket?.readyState !== WebSocket.OPEN || !this.store.connected) return false;
    this.socket.send(JSON.stringify({ ...text, clock: pageTime() }));
    return true;
  }

  /** Sends a text and waits for its answer; without a link, or without an answer in time, that is a no. */
  ask(text: { type: string; [key: string]: unknown }): Promise<Answer> {
    const id = this.nextId++;
    return new Promise((resolve) => {
      if (!this.send({ ...text, id })) return resolve({ ok: false, why: "there is no link" });
      this.pending.set(id, resolve);
      const within = text.type === "take" ? TAKE_WITHIN_MS : ANSWER_WITHIN_MS;
      setTimeout(() => {
        if (this.pending.delete(id)) resolve({ ok: false, why: "the gateway did not answer" });
      }, within);
    });
  }

  /** Shows why something was refused, or done in another way than was asked. */
  private tellWhy({ ok, why }: Answer, what = ""): void {
    if (!ok || why) this.store.tell("notice", `${what}${why || "refused"}`);
  }

  /** Asks, and shows the reason where the answer is no. */
  async request(text: { type: string; [key: string]: unknown }): Promise<boolean> {
    const answer = await this.ask(text);
    this.tellWhy(answer, `${text.type.replace("_", " ")}: `);
    return answer.ok;
  }
}
