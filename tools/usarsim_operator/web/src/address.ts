// What the fragment of the page's address says: the token, then options as of a query (`#TOKEN&panel=classic`).

export const PANELS = ["full", "classic"] as const;

export interface Address {
  token: string;
  /** `classic`: the panel of the RSARSim paper, of pictures and laser, without map and 3D view. */
  panel: (typeof PANELS)[number];
  /** Where the page that shows this one inside it is dark or light. */
  theme: "dark" | "light" | null;
  /** Whose session of a study this is: changed keys are theirs alone. */
  session: string;
}

export function addressOf(hash: string): Address {
  const [token = "", ...rest] = hash.replace(/^#/, "").split("&");
  const options = new URLSearchParams(rest.join("&"));
  const theme = options.get("theme");
  return {
    token: decodeURIComponent(token),
    panel: PANELS.find((one) => one === options.get("panel")) ?? "full",
    theme: theme === "dark" || theme === "light" ? theme : null,
    session: (options.get("session") ?? "").slice(0, 64),
  };
}
