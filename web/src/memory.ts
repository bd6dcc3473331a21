// What the browser remembers of the page; in a frame of a notebook there is nothing to remember it in.

export function recall(name: string): string | null {
  try {
    return localStorage.getItem(name);
  } catch {
    return null;
  }
}

export function remember(name: string, value: string): void {
  try {
    localStorage.setItem(name, value);
  } catch {
    // nothing is lost but the preference
  }
}

/** The part of the address behind #, where there is an address. */
export function address(hash: string): void {
  try {
    history.replaceState(null, "", `#${hash}`);
  } catch {
    // a frame without an address
  }
  if (parent !== window) parent.postMessage({ workbench: hash }, "*"); // a widget of a notebook keeps it
}
