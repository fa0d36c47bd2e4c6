// What is printed on the keys that do something. Keys are bound by their place; which letter stands there depends on the
// keyboard: the browser tells it, or the first press of a key does.

import { type Action, type Bindings, keyText } from "./bindings";

interface LayoutMap {
  forEach(visit: (letter: string, code: string) => void): void;
}

type Keyboards = Navigator & {
  keyboard?: { getLayoutMap?: () => Promise<LayoutMap> };
};

/** Places whose letter depends on the keyboard's layout. */
const LETTERED =
  /^(Key[A-Z]|Semicolon|Comma|Period|Slash|Quote|Minus|Equal|Backquote|Bracket\w+|Backslash|Intl\w+)$/;

export class KeyNames {
  /** The letter printed on a key, by the key's code. */
  readonly letters = new Map<string, string>();

  constructor(
    public bindings: Bindings,
    private readonly changed: () => void = () => {},
  ) {}

  /** Asks the browser for the layout, where it tells one, and learns from keys that are pressed. */
  watch(): void {
    (navigator as Keyboards).keyboard
      ?.getLayoutMap?.()
      .then((map) => {
        map.forEach((letter, code) => {
          this.learn(code, letter);
        });
      })
      .catch(() => {}); // a frame may not ask; presses tell it
    addEventListener(
      "keydown",
      ({ code, key, shiftKey, ctrlKey, altKey, metaKey }) => {
        if (!shiftKey && !ctrlKey && !altKey && !metaKey) this.learn(code, key);
      },
      true,
    );
  }

  learn(code: string, letter: string): void {
    if (!LETTERED.test(code) || [...letter].length !== 1 || letter === " ") return;
    const upper = letter.toUpperCase();
    const printed = [...upper].length === 1 ? upper : letter;
    if (this.letters.get(code) === printed) return;
    this.letters.set(code, printed);
    this.changed();
  }

  /** A key for people, by its code: what is printed on it. */
  name(code: string): string {
    return this.letters.get(code) ?? keyText(code);
  }

  /** The same for messages about codes, which a file of keys has: `KeyW`, or `Z (KeyW)` where Z is printed there. */
  exact(code: string): string {
    const name = this.name(code);
    return name === keyText(code) ? code : `${name} (${code})`;
  }

  /** The first key of an action; "no key" where it has none. */
  of(action: Action): string {
    const [code] = this.bindings.keys[action];
    return code === undefined ? "no key" : this.name(code);
  }
}
