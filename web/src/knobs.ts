// The controls: names, effects and ranges.

import { digits, shown } from "./units";
import type { Settings } from "./state";

export interface Knob<S = Settings> {
  key: string;
  group: string;
  label: string;
  help: string;
  unit: string;
  get(s: S): number;
  set(s: S, value: number): void;
  /** Minimum, maximum, and whether the scale is logarithmic; with `zero`, the left end is 0. */
  range(own: S): { from: number; to: number; log: boolean; zero?: boolean };
}

function of(key: string, group: string, label: string, unit: string, help: string,
            range: Knob["range"]): Knob {
  return { key, group, label, unit, help, range, get: (s) => s.p[key], set: (s, value) => (s.p[key] = value) };
}

const about = (key: string, by: number): Knob["range"] => (own) => ({ from: own.p[key] / by, to: own.p[key] * by, log: true });

function root(key: string, group: string, label: string, unit: string, help: string): Knob {
  return {
    key, group, label, unit, help, get: (s) => Math.sqrt(s.p[key]), set: (s, value) => (s.p[key] = value * value),
    range: (own) => ({ from: Math.sqrt(own.p[key]) / 30, to: Math.sqrt(own.p[key]) * 30, log: true, zero: false }),
  };
}

function plain(key: "R" | "Q" | "reference" | "push" | "seed", group: string, label: string, unit: string, help: string,
               range: Knob["range"]): Knob {
  return { key, group, label, unit, help, range, get: (s) => s[key], set: (s, value) => (s[key] = value) };
}

const weight = (own: Settings) => Math.max(Math.abs(own.push), Math.abs(own.p.gravity) * own.p.mass * 9.81);

export const KNOBS: Knob[] = [
  of("kp", "Controller", "Proportional gain", "A/m", "Stiffness of the loop, k_p", about("kp", 6)),
  of("ki", "Controller", "Integral gain", "A/(m s)", "Takes away what stays of the error, k_i", (own) => ({ from: own.p.ki / 100, to: own.p.ki * 30, log: true, zero: true })),
  of("kd", "Controller", "Derivative gain", "A s/m", "Damping of the loop, k_d", (own) => ({ from: own.p.kd / 20, to: own.p.kd * 6, log: true, zero: true })),
  of("s0", "Machine", "Air gap", "m", "From the pole to the rotor in the middle", (own) => ({ from: Math.max(own.p.clearance * 1.05, own.p.s0 / 2), to: own.p.s0 * 2, log: true })),
  of("i0", "Machine", "Bias current", "A", "Flows in the coil before the controller acts", about("i0", 3)),
  of("mass", "Machine", "Rotor mass", "kg", "", about("mass", 4)),
  of("k", "Machine", "Magnet constant", "N m^2/A^2", "Force is k (i/gap)²", about("k", 2)),
  root("noise_y", "Sensor and amplifier", "Sensor noise", "m", "Standard deviation"),
  of("step", "Sensor and amplifier", "Quantisation", "m", "Smallest step of the reading", (own) => ({ from: 1e-3 * Math.sqrt(own.p.noise_y), to: 100 * Math.sqrt(own.p.noise_y), log: true, zero: true })),
  of("lag", "Sensor and amplifier", "Sensor lag", "s", "Time constant", (own) => ({ from: own.p.T / 20, to: own.p.T * 40, log: true, zero: true })),
  of("delay", "Sensor and amplifier", "Dead time", "s", "From the sample to the current that it asks for", (own) => ({ from: 0, to: 3 * own.p.T, log: false })),
  of("bandwidth", "Sensor and amplifier", "Amplifier bandwidth", "Hz", "0: the current follows at once", (own) => ({ from: 10 / own.p.T / 200, to: 0.5 / own.p.T, log: true, zero: true })),
  root("noise_u", "Sensor and amplifier", "Amplifier noise", "V", "Standard deviation"),
  of("filter_k", "Filters", "Assumed k / true k", "1", "How wrong the filters are about the magnet", () => ({ from: 0.5, to: 1.6, log: false })),
  plain("R", "Filters", "R / own R", "1", "Assumed variance of the measurement", () => ({ from: 1e-3, to: 1e3, log: true })),
  plain("Q", "Filters", "Q / own Q", "1", "Assumed growth of the disturbance force", () => ({ from: 1e-4, to: 1e4, log: true })),
  plain("reference", "Flight", "Reference step", "m", "At a tenth of the flight", (own) => ({ from: -0.6 * own.p.clearance, to: 0.6 * own.p.clearance, log: false })),
  plain("push", "Flight", "Disturbance force", "N", "Half-way through the flight", (own) => ({ from: -3 * weight(own), to: 3 * weight(own), log: false })),
  plain("seed", "Flight", "Seed of the noise", "1", "The same seed gives the same noise, here and in Python", () => ({ from: 0, to: 50, log: false })),
];

const STEPS = 1000;

/** Convert a value to the position of a slider, 0 to STEPS, and back. */
export function toSlider<S>(knob: Knob<S>, own: S, value: number): number {
  const { from, to, log, zero } = knob.range(own);
  if (!log) return Math.round((STEPS * (value - from)) / (to - from));
  if (zero && value < from) return 0;
  return Math.round((STEPS * Math.log(value / from)) / Math.log(to / from));
}

export function fromSlider<S>(knob: Knob<S>, own: S, at: number): number {
  const { from, to, log, zero } = knob.range(own);
  if (knob.key === "seed") return Math.round(from + (at / STEPS) * (to - from));
  if (zero && at <= 0) return 0;
  const value = log ? from * (to / from) ** (at / STEPS) : from + (at / STEPS) * (to - from);
  const near = Math.abs(value) < 1e-9 * Math.abs(to) ? 0 : value;
  return Number(near.toPrecision(3));
}

/** A slider with its number; a double click restores the machine's own value. */
export function slider<S>(knob: Knob<S>, own: S, now: () => S, turned: () => void): { row: HTMLElement; show(): void } {
  const row = document.createElement("div"), id = `knob-${knob.key}`;
  row.className = "knob";
  const label = document.createElement("label"), input = document.createElement("input"), value = document.createElement("button");
  label.htmlFor = id;
  label.textContent = knob.label;
  label.title = knob.help;
  Object.assign(input, { type: "range", id, min: "0", max: String(STEPS), step: "1" });
  value.className = "value";
  value.type = "button";
  const show = () => {
    const at = knob.get(now()), text = knob.unit === "1" ? digits(at) : shown(at, knob.unit);
    input.value = String(toSlider(knob, own, at));
    input.setAttribute("aria-valuetext", text);
    value.textContent = text;
    const changed = at !== knob.get(own);
    row.classList.toggle("changed", changed);
    value.title = changed ? "Back to the machine's own value" : knob.help;
    value.setAttribute("aria-label", changed ? `${knob.label}: ${text}; back to the machine's own` : `${knob.label}: ${text}`);
  };
  input.addEventListener("input", () => {
    knob.set(now(), fromSlider(knob, own, Number(input.value)));
    show();
    turned();
  });
  const back = () => {
    knob.set(now(), knob.get(own));
    show();
    turned();
  };
  input.addEventListener("dblclick", back);
  value.addEventListener("click", back);
  row.append(label, value, input);
  show();
  return { row, show };
}
