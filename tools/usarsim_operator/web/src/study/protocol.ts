// What the page of a study and its desk say to each other (docs/studies.md). Pure: types, and what of a form is missing.

export type Value = number | string | boolean;

export interface Item {
  name: string;
  text: string;
  kind: "scale" | "choice" | "text" | "flag";
  required: boolean;
  low?: number;
  high?: number;
  step?: number;
  left?: string;
  right?: string;
  choices?: { name: string; text: string }[];
}

export interface Form {
  form: string;
  kind: string;
  title: string;
  instructions: string;
  pages: Item[][];
}

export interface TextStep {
  type: "step";
  step: number;
  kind: "text";
  title: string;
  text: string;
  button: string | null;
}

export interface FormStep {
  type: "step";
  step: number;
  kind: "form";
  form: Form;
  answers: Record<string, Value>;
  page: number;
  freeze?: boolean;
}

export interface PanelStep {
  type: "step";
  step: number;
  kind: "panel";
  url: string;
  line: string;
}

export interface WaitStep {
  type: "step";
  step: number;
  kind: "wait";
  text: string;
}

export interface EndStep {
  type: "step";
  step: number;
  kind: "end";
  title: string;
  text: string;
}

export type Step = (TextStep | FormStep | PanelStep | WaitStep | EndStep) & {
  /** Whose session it is, so that no answer of one participant becomes another one's. */
  session?: string;
};

export interface Overview {
  type: "overview";
  participant: string | null;
  number: number | null;
  /** Of the participant, or of the study's end with them: `running`, `complete`, `withdrawn`, `excluded`. */
  status?: string;
  reason?: string;
  step: { kind?: string; what?: string } | null;
  /** What stands before the participant and what comes next, in plain words. */
  now?: string;
  next?: string;
  /** The step belongs to a training, which can be passed. */
  training?: boolean;
  trial: number | null;
  attempt: number | null;
  time: number | null;
  score: number | null;
  /** The instructor's page of the trial that runs. */
  panel?: string | null;
  /** Why nothing can be stored; empty: all is well. */
  trouble?: string;
  seats: { seat: number | string; connected: boolean }[];
  events: string[];
  /** Whom an inject may be about. */
  robots?: string[];
  victims?: string[];
}

export interface Refused {
  type: "refused";
  step: number;
  why: string;
  missing?: string[];
  item?: string;
}

export type Told =
  | Step
  | Overview
  | Refused
  | { type: "saved"; step: number; item: string }
  | { type: "done"; do: string }
  | { type: "pong" };

/** Values of a scale, from low to high. */
export function valuesOf({ low = 0, high = 100, step = 1 }: Item): number[] {
  const steps = Math.max(0, Math.round((high - low) / step));
  return Array.from({ length: steps + 1 }, (_, i) => Number((low + i * step).toFixed(9)));
}

/** Whether a value is an answer at all; a text of blanks is none to a question that wants one. */
export function answers(item: Item, value: Value | undefined): boolean {
  if (value === undefined) return false;
  return item.kind !== "text" || !item.required || String(value).trim() !== "";
}

/** Required items of a page that have no answer. */
export function missing(page: Item[], given: Record<string, Value>): string[] {
  return page
    .filter((one) => one.required && !answers(one, given[one.name]))
    .map((one) => one.name);
}
