// Dark or light: as the address says, as it was chosen here before, else as the system has it.

import { forgetColours } from "./dom";

export function firstTheme(told: string | null = null): void {
  const saved = told ?? localStorage.getItem("usarsim-theme");
  const light = matchMedia("(prefers-color-scheme: light)").matches;
  document.documentElement.dataset.theme = saved ?? (light ? "light" : "dark");
}

export function switchTheme(): void {
  const root = document.documentElement;
  root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark";
  localStorage.setItem("usarsim-theme", root.dataset.theme);
  forgetColours();
}
