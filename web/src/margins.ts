// The sensitivity of a loop, measured as on a rig: from its response to a small pulse on the
// reading.

import type { Core, Parameters } from "./core";

export interface Sensitivity {
  f: number[]; // [Hz]
  S: number[]; // |S|
  peak: number;
  at: number; // [Hz]
  stable: boolean;
}

/** Zones of ISO 14839-3, with the peaks of |S| at their upper limits. */
export const ZONES: [string, number][] = [["A", 3], ["B", 4], ["C", 5]];

export function zone(of: Sensitivity): string {
  if (!of.stable) return "unstable";
  return ZONES.find(([, end]) => of.peak < end)?.[0] ?? "D";
}

/** Frequencies from a twentieth of the rotor's unstable pole to half the sampling rate [Hz]. */
export function grid(own: number, T: number, points: number): number[] {
  const low = Math.min(own / (40 * Math.PI), 0.1 / T), high = 0.5 / T;
  return Array.from({ length: points }, (_, k) => low * (high / low) ** (k / (points - 1)));
}

/** |S| on a grid, refined about its three highest points, because a bending mode is narrower than the grid. */
export function judged(f: number[], stable: boolean, gains: (f: number[]) => number[]): Sensitivity {
  const S = gains(f), high = f.map((_, k) => k).filter((k) => k > 0 && k < f.length - 1 && S[k] >= S[k - 1] && S[k] >= S[k + 1]);
  const fine = high.sort((a, b) => S[b] - S[a]).slice(0, 5).flatMap((k) => Array.from({ length: 40 }, (_, j) => f[k - 1] + ((f[k + 1] - f[k - 1]) * (j + 0.5)) / 40));
  const all = [...f.map((at, k): [number, number] => [at, S[k]]), ...gains(fine).map((gain, k): [number, number] => [fine[k], gain])].sort((a, b) => a[0] - b[0]);
  const [at, peak] = all.reduce((a, b) => (b[1] > a[1] ? b : a));
  return { f: all.map(([one]) => one), S: all.map(([, one]) => one), peak: stable ? peak : Infinity, at, stable };
}

/** Of an axis with this filter, in equilibrium at the reference. */
export function sensitivity(core: Core, p: Parameters, kind: number, points = 240): Sensitivity | null {
  core.state(p);
  const { k_s } = core.magnet(core.levitation(p.reference, 0), p.reference), f = grid(Math.sqrt(Math.abs(k_s) / p.mass), p.T, points);
  const stable = core.sensitivity(kind);
  return stable === null ? null : judged(f, stable, (at) => core.gains(at));
}

/** Deferred work in pieces, after drawing; new work replaces the old. */
export class Later {
  private queue: (() => void)[] = [];
  private timer = 0;

  start(work: (() => void)[]): void {
    window.clearTimeout(this.timer);
    this.queue = work;
    this.timer = window.setTimeout(() => this.next(), 40);
  }

  private next(): void {
    this.queue.shift()?.();
    if (this.queue.length) this.timer = window.setTimeout(() => this.next(), 0);
  }

  /** Complete the remaining work immediately. */
  finish(): void {
    window.clearTimeout(this.timer);
    while (this.queue.length) this.queue.shift()!();
  }
}
