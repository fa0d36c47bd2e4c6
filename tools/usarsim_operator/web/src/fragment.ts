// What stands behind # of the page's address, the token above all: the tab keeps it, and neither its address bar nor the browser's history.

const KEY = "usarsim-fragment";

function kept(): Storage | null {
  try {
    return window.sessionStorage;
  } catch {
    return null; // a browser that keeps nothing
  }
}

/** What the address says, else what this tab was told before it was reloaded. */
export function fragment(): string {
  return location.hash.length > 1 ? location.hash : (kept()?.getItem(KEY) ?? "");
}

/** Takes it out of the address, once the token has been accepted; a reload finds it all the same. */
export function hideFragment(): void {
  const storage = kept();
  if (storage === null || location.hash.length < 2) return;
  try {
    storage.setItem(KEY, location.hash);
  } catch {
    return; // without it a reload could not say hello
  }
  history.replaceState(history.state, "", location.pathname + location.search);
}

/** Somebody gives this tab another token: browsers load nothing for that by themselves. */
export function watchFragment(): void {
  addEventListener("hashchange", () => {
    if (location.hash.length > 1) location.reload();
  });
}
