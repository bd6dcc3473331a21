// Storage of the page's settings in the browser; a frame of a notebook has none.

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
    // only the preference is lost
  }
}

/** The part of the address behind #, if there is an address. */
export function address(hash: string): void {
  try {
    history.replaceState(null, "", `#${hash}`);
  } catch {
    // a frame without an address
  }
  // a notebook's widget stores it
  if (parent !== window) parent.postMessage({ workbench: hash }, "*");
}
