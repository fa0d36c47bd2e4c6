// Answers that the desk has not said to be on its disk. They outlive the connection, and a reload of the page: the
// tab's own storage keeps them until then. Pure but for the storage that is given to it.

import type { Value } from "./protocol";

export interface Given {
  value: Value | null;
  clock: number;
}

interface Kept {
  form: string;
  shown: number;
  answers: Record<string, Given>;
}

const KEY = "usarsim-study-unsaved";

export class Unsaved {
  private form = "";
  private shown = 0;
  private readonly kept = new Map<string, Given>();
  /** How often each was sent over this connection without being saved yet. */
  private readonly sent = new Map<string, number>();

  constructor(
    private readonly storage: Pick<Storage, "getItem" | "setItem"> | null,
    private readonly now: () => number,
  ) {}

  /** Begins with a form, or goes on with it: what this tab has kept of the same one still counts. */
  open(form: string): void {
    if (form === this.form) return;
    this.form = form;
    this.kept.clear();
    this.sent.clear();
    const before = this.stored();
    this.shown = before?.form === form ? before.shown : this.now();
    if (before?.form === form)
      for (const [item, given] of Object.entries(before.answers)) this.kept.set(item, given);
    this.store();
  }

  /** Ends with the form: another step has come. */
  close(): void {
    this.open("");
  }

  /** s since the form was shown, reloads of the page included. */
  get clock(): number {
    return Math.max(0, this.now() - this.shown);
  }

  get size(): number {
    return this.kept.size;
  }

  give(item: string, value: Value | null): Given {
    const given = { value, clock: Number(this.clock.toFixed(3)) };
    this.kept.set(item, given);
    this.store();
    return given;
  }

  /** Another connection: nothing is under way on it. */
  reconnect(): [string, Given][] {
    this.sent.clear();
    return [...this.kept];
  }

  sending(item: string): void {
    this.sent.set(item, (this.sent.get(item) ?? 0) + 1);
  }

  /** An answer of the item is on disk: the newest one, if no other is under way. */
  saved(item: string): void {
    const left = (this.sent.get(item) ?? 1) - 1;
    this.sent.set(item, left);
    if (left > 0) return;
    this.sent.delete(item);
    this.kept.delete(item);
    this.store();
  }

  /** Answers as they stand here, over those that the desk has. */
  over(answers: Record<string, Value>): Record<string, Value> {
    const all = { ...answers };
    for (const [item, { value }] of this.kept) {
      if (value === null) delete all[item];
      else all[item] = value;
    }
    return all;
  }

  private stored(): Kept | null {
    try {
      return JSON.parse(this.storage?.getItem(KEY) ?? "null") as Kept | null;
    } catch {
      return null;
    }
  }

  private store(): void {
    const kept: Kept = {
      form: this.form,
      shown: this.shown,
      answers: Object.fromEntries(this.kept),
    };
    try {
      this.storage?.setItem(KEY, JSON.stringify(kept));
    } catch {
      // A full or forbidden storage keeps nothing over a reload; the connection still sends all of it.
    }
  }
}
