// Forms of a study: what is missing, and answers until the desk has them (HRI-07, O-42).

import assert from "node:assert/strict";
import { test } from "node:test";
import { addressOf } from "../src/address";
import { type Item, missing, valuesOf } from "../src/study/protocol";
import { Unsaved } from "../src/study/unsaved";

const tlx: Item = {
  name: "effort",
  text: "Effort",
  kind: "scale",
  required: true,
  low: 0,
  high: 100,
  step: 5,
};

function storage(): Pick<Storage, "getItem" | "setItem"> {
  const kept = new Map<string, string>();
  return {
    getItem: (key) => kept.get(key) ?? null,
    setItem: (key, value) => {
      kept.set(key, value);
    },
  };
}

test("O-42: a NASA-TLX scale has 21 ticks, the multiples of 5", () => {
  const values = valuesOf(tlx);
  assert.equal(values.length, 21);
  assert.ok(values.every((value, place) => value === 5 * place));
  assert.deepEqual(valuesOf({ ...tlx, low: 0, high: 0.3, step: 0.1 }), [0, 0.1, 0.2, 0.3]);
});

test("O-42: what is required and not answered is missing; zero, no and blanks told apart", () => {
  const text: Item = { name: "words", text: "?", kind: "text", required: true };
  const open: Item = { ...text, name: "open", required: false };
  const page = [tlx, text, open];
  assert.deepEqual(missing(page, {}), ["effort", "words"]);
  assert.deepEqual(missing(page, { effort: 0, words: "  " }), ["words"]);
  assert.deepEqual(missing(page, { effort: 0, words: "x" }), []);
  assert.deepEqual(missing([{ ...tlx, kind: "flag" }], { effort: false }), []);
});

test("HRI-07: what is not saved stays over a reload, is told again, and lies over the desk's", () => {
  const tab = storage();
  let now = 100;
  const before = new Unsaved(tab, () => now);
  before.open("7 tlx");
  now = 104.5;
  assert.deepEqual(before.give("effort", 40), { value: 40, clock: 4.5 });
  before.give("mental", null);
  now = 110;
  const after = new Unsaved(tab, () => now);
  after.open("7 tlx");
  assert.equal(after.clock, 10);
  assert.deepEqual(after.over({ effort: 5, mental: 10, physical: 15 }), {
    effort: 40,
    physical: 15,
  });
  assert.deepEqual(
    after.reconnect().map(([item]) => item),
    ["effort", "mental"],
  );
  const other = new Unsaved(tab, () => now);
  other.open("8 tlx");
  assert.equal(other.size, 0);
});

test("an answer changed while the first one is under way is saved by its own", () => {
  const unsaved = new Unsaved(storage(), () => 0);
  unsaved.open("1 sus");
  for (const value of [1, 2]) {
    unsaved.give("sus_1", value);
    unsaved.sending("sus_1");
  }
  unsaved.saved("sus_1");
  assert.equal(unsaved.size, 1);
  unsaved.saved("sus_1");
  assert.equal(unsaved.size, 0);
  unsaved.give("sus_2", 3);
  unsaved.sending("sus_2");
  unsaved.reconnect();
  unsaved.sending("sus_2");
  unsaved.saved("sus_2");
  assert.equal(unsaved.size, 0);
});

test("the address of a panel tells token, variant and theme, and no more than they may be", () => {
  assert.deepEqual(addressOf("#a%2Fb&panel=classic&theme=light&session=K7QX"), {
    token: "a/b",
    panel: "classic",
    theme: "light",
    session: "K7QX",
  });
  assert.deepEqual(addressOf("#secret"), {
    token: "secret",
    panel: "full",
    theme: null,
    session: "",
  });
  assert.deepEqual(addressOf("#s&panel=<b>&theme=blue"), {
    token: "s",
    panel: "full",
    theme: null,
    session: "",
  });
});
