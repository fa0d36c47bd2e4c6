// The page of a seat in a study: the participant's steps, or the experimenter's view.

import { h, mark, say } from "../dom";
import { firstTheme, switchTheme } from "../theme";
import { Desk } from "./desk";
import { Experimenter } from "./experimenter";
import { Stage } from "./stage";

function start(): void {
  firstTheme();
  const state = h(
    "span",
    { class: "chip link", role: "status", "data-link": "lost" },
    "connecting",
  );
  const note = h("p", { class: "notice", role: "status", "data-notice": true, hidden: true });
  const theme = h("button", { type: "button", "data-do": "theme", title: "dark or light" }, "◐");
  theme.setAttribute("aria-label", "dark or light");
  theme.addEventListener("click", switchTheme);
  const header = h(
    "header",
    { class: "bar" },
    h("span", { class: "brand" }, "usarsim study"),
    h("div", { class: "spring" }),
    state,
    theme,
  );
  let experimenter: Experimenter | null = null;
  let timer = 0;
  const notice = (text: string): void => {
    say(note, text);
    note.hidden = false;
    clearTimeout(timer);
    timer = window.setTimeout(() => {
      note.hidden = true;
    }, 6000);
  };
  const link = (): void => {
    const { connected, why, unsaved } = desk;
    const waiting = unsaved.size > 0;
    mark(state, "data-link", connected ? "good" : "lost");
    mark(state, "data-unsaved", String(unsaved.size));
    // A desk may end with its last session: at the end a participant needs it no more.
    state.hidden = !connected && !waiting && !experimenter && desk.step?.kind === "end";
    const kept = waiting ? "; your answers are kept here" : "";
    say(
      state,
      connected
        ? waiting
          ? "saving"
          : "connected"
        : why || `the desk does not answer, trying again${kept}`,
    );
    mark(document.documentElement, "data-connected", connected);
  };
  const desk = new Desk({
    step: (step) => {
      if (experimenter) return;
      mark(document.documentElement, "data-kind", step.kind);
      stage.show(step);
    },
    overview: (overview) => {
      if (!experimenter) {
        experimenter = new Experimenter(desk);
        mark(document.documentElement, "data-kind", "experimenter");
        stage.element.replaceWith(experimenter.element);
      }
      experimenter.show(overview);
    },
    refused: (refused) => {
      const missing = refused.missing ?? [];
      if (!experimenter && refused.step === desk.step?.step) stage.refused(refused.why, missing);
      if (experimenter || missing.length === 0) notice(refused.why);
    },
    done: (deed) => notice(`done: ${deed.replace("_", " ")}`),
    link,
  });
  const stage = new Stage(desk);
  document.body.append(header, stage.element, note);
  // For tests of the browser: what the page knows.
  Object.assign(window, { study: desk });
  desk.open();
}

start();
