// Gains for a machine: the stiffest with a low sensitivity, chosen as ambkit's defaults are.

import type { Core, Parameters } from "./core";
import { sensitivity } from "./margins";

const PEAK = 1.8;
const RATIOS = [4, 3.5, 3, 2.6, 2.3, 2, 1.8, 1.6, 1.4];
const DAMPINGS = [1.5, 1.3, 1.1, 0.95, 0.8, 0.65, 0.5];

const two = (value: number) => Number(value.toPrecision(2));

/** Gains by the ratio k_p k_i/k_s and the damping. */
function gains(p: Parameters, k_i: number, k_s: number, ratio: number, damping: number): Partial<Parameters> {
  const w = Math.sqrt(((ratio - 1) * k_s) / p.mass), kp = two((ratio * k_s) / k_i);
  return {
    kp, ki: two((kp * w) / 31), kd: two((2 * damping * p.mass * w) / k_i), T_f: two(1 / (24 * w)), T_t: two(5.2 / w), weight: 0.5,
  };
}

/** The selected gains, and their peak of |S|. */
export function tuned(core: Core, p: Parameters, kind: number): { gains: Partial<Parameters>; peak: number } {
  core.state(p);
  const { k_i, k_s } = core.magnet(0, 0);
  let best = { gains: gains(p, k_i, k_s, 4, 0.56), peak: Infinity };
  for (const ratio of RATIOS) {
    for (const damping of DAMPINGS) {
      const tried = gains(p, k_i, k_s, ratio, damping);
      const peak = sensitivity(core, { ...p, ...tried, reference: 0, load: 0, start: 0 } as Parameters, kind, 60)?.peak ?? Infinity;
      if (peak < best.peak) best = { gains: tried, peak };
    }
    if (best.peak <= PEAK) break;
  }
  return best;
}
