// What can be set of a rotor, and the description that follows from it.

import type { Knob } from "./knobs";
import type { Filtering, Rotor } from "./rotor_core";

export interface RotorSettings {
  speed: number; // [rad/s]
  runUp: boolean; // from rest to that speed over the flight
  unbalance: number; // times its own [1], and so the next ones
  mass: number;
  gap: number;
  bias: number;
  kp: number;
  ki: number;
  kd: number;
  noise: number;
  lag: number;
  delay: number; // [s]
  filter: number; // 0 none, 1 linear, 2 extended
  assumed: number; // of the magnets, by the filter over the true ones [1]
  Q: number;
  push: number; // step of a force on the first axis, half-way [N]
  seed: number;
  noisy: boolean;
}

const G = 9.81;

export function freshRotor(of: Rotor): RotorSettings {
  return {
    speed: of.speed, runUp: false, unbalance: 1, mass: 1, gap: 1, bias: 1, kp: 1, ki: 1, kd: 1, noise: 1, lag: 1, filter: 2, assumed: 1, Q: 1,
    delay: of.delay * of.T + of.delay_rest, push: Number((0.2 * of.mass * G).toPrecision(2)), seed: 1, noisy: true,
  };
}

function times(key: "unbalance" | "Q" | "mass" | "gap" | "bias" | "kp" | "ki" | "kd" | "noise" | "lag", group: string, label: string, by: number, help = ""): Knob<RotorSettings> {
  return {
    key, group, label: `${label} / own`, help, unit: "1", get: (s) => s[key], set: (s, value) => (s[key] = value),
    range: () => ({ from: 1 / by, to: by, log: true, zero: key === "unbalance" || key === "noise" }),
  };
}

export const ROTOR_KNOBS = (of: Rotor): Knob<RotorSettings>[] => [
  {
    key: "speed", group: "Rotation", label: "Speed", help: "Of rotation", unit: "rpm", get: (s) => (s.speed * 30) / Math.PI,
    set: (s, value) => (s.speed = (value * Math.PI) / 30), range: (own) => ({ from: 0, to: (2.5 * Math.max(own.speed, 100) * 30) / Math.PI, log: false }),
  },
  times("unbalance", "Rotation", "Unbalance", 30, "Turns with the rotor"),
  times("kp", "Controllers", "Proportional gain", 4),
  times("ki", "Controllers", "Integral gain", 20),
  times("kd", "Controllers", "Derivative gain", 6),
  times("gap", "Machine", "Air gap", 1.8),
  times("bias", "Machine", "Bias current", 2),
  times("mass", "Machine", "Mass and inertia", 3),
  times("noise", "Sensors", "Sensor noise", 50, "Standard deviation"),
  times("lag", "Sensors", "Sensor lag", 20),
  {
    key: "delay", group: "Sensors", label: "Dead time", help: "From the sample to the current that it asks for", unit: "s",
    get: (s) => s.delay, set: (s, value) => (s.delay = value), range: () => ({ from: 0, to: 6 * of.T, log: false }),
  },
  ...(of.filter ? [
    {
      key: "assumed", group: "Filter", label: "Assumed k / true k", help: "How wrong the filter is about the magnets", unit: "1",
      get: (s: RotorSettings) => s.assumed, set: (s: RotorSettings, value: number) => (s.assumed = value), range: () => ({ from: 0.5, to: 1.6, log: false }),
    },
    times("Q", "Filter", "Q", 1e4, "Assumed growth of the disturbance forces"),
  ] : []),
  {
    key: "push", group: "Flight", label: "Disturbance force", help: "On the first axis, half-way through the flight", unit: "N",
    get: (s) => s.push, set: (s, value) => (s.push = value), range: (own) => ({ from: -4 * Math.abs(own.push), to: 4 * Math.abs(own.push), log: false }),
  },
  {
    key: "seed", group: "Flight", label: "Seed of the noise", help: "The same seed gives the same noise, here and in Python", unit: "1",
    get: (s) => s.seed, set: (s, value) => (s.seed = value), range: () => ({ from: 0, to: 50, log: false }),
  },
];

/** The control current that pulls with a force in the middle [A]: of two sides, F = 4 k i0 iu / s0^2. */
function holds(magnet: number[], force: number): number {
  const [k, s0, i0] = magnet;
  return (force * s0 * s0) / (4 * k * i0);
}

/** The description of a rotor with these settings; with its own, it is what Python states. */
export function described(own: Rotor, s: RotorSettings): Rotor {
  const same = s.mass === 1 && s.gap === 1 && s.bias === 1;
  const magnets = own.magnets.map(([k, s0, i0, two]) => [k, s0 * s.gap, i0 * s.bias, two]);
  const held = same ? own.held : own.magnets.map((magnet, f) => holds(magnets[f], (s.mass * own.held[f] * 4 * magnet[0] * magnet[2]) / magnet[1] ** 2));
  const rows = (of: [number[], number[], number[]]): [number[], number[], number[]] => [of[0], of[1], of[2].map((value) => value / s.mass)];
  const samples = s.delay / own.T, whole = Math.floor(samples + 1e-9), delayed = s.delay !== own.delay * own.T + own.delay_rest;
  const lag = own.lag.map((value) => value * s.lag);
  return {
    ...own, magnets, held,
    B: s.mass === 1 ? own.B : rows(own.B),
    cosine: own.cosine.map((value) => (value * s.unbalance) / s.mass),
    sine: own.sine.map((value) => (value * s.unbalance) / s.mass),
    farthest: s.gap === 1 ? own.farthest : own.farthest.map((far, f) => {
      const clearance = own.rings[f >> 1]?.[2] ?? far;
      return clearance + 0.9 * Math.max(0, magnets[f][1] - clearance);
    }),
    lag, substeps: Math.max(own.substeps, Math.ceil((2 * own.T) / Math.min(...lag))),
    delay: delayed ? whole : own.delay,
    delay_rest: delayed ? Math.max(0, samples - whole) * own.T : own.delay_rest,
    pid: own.pid.map(([kp, ki, kd, ...rest]) => [kp * s.kp, ki * s.ki, kd * s.kd, ...rest]),
    integral: same ? own.integral : held,
    var_y: own.var_y.map((value) => value * s.noise * s.noise),
  };
}

/** The filter that goes with these settings: it knows of speed, mass, lag and noise, not of dead time and unbalance. */
export function filtering(own: Rotor, s: RotorSettings): Filtering | null {
  const of = own.filter;
  if (!of || (s.filter !== 1 && s.filter !== 2)) return null;
  const by: Record<string, number> = { mass: s.mass, transverse_inertia: s.mass, polar_inertia: s.mass };
  const parameters = of.names.map((name, k) => (name === "speed" ? s.speed : name.startsWith("lag_") ? of.values[k] * s.lag : of.values[k] * (by[name] ?? 1)));
  const scaled = (name: string, factor: number) => (factor === 1 ? of.settings[name] : of.settings[name].map((value) => value * factor));
  const settings = {
    ...of.settings, lag: scaled("lag", s.lag), f_0: scaled("f_0", s.mass), var_y: scaled("var_y", Math.max(s.noise, 0.02) ** 2), var_d: scaled("var_d", s.Q),
  };
  return { kind: s.filter, of: { ...of, settings }, parameters, k: s.assumed };
}
