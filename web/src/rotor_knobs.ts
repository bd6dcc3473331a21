// Settings of a rotor, and the resulting description.

import type { Knob } from "./knobs";
import { KINDS } from "./core";
import type { Assumed, Controllers, Rotor } from "./rotor_core";
import { FILTERS } from "./state";

export interface RotorSettings {
  speed: number; // [rad/s]
  runUp: boolean; // run-up from standstill to that speed
  unbalance: number; // times its own [1]; also the following ones
  mass: number;
  gap: number;
  bias: number;
  kp: number;
  ki: number;
  kd: number;
  noise: number;
  lag: number;
  delay: number; // [s]
  step: number; // quantisation of all sensors [m]
  feedback: number; // 1: the first filter feeds the controllers, 0: the sensors
  filters: string; // names of the kinds, separated by commas; the first is in the loop
  assumed: number; // magnet constants of the filters over the true ones [1]
  R: number;
  Q: number;
  push: number; // step of a force on the first axis, at half of the run [N]
  seed: number;
  noisy: boolean;
}

const G = 9.81;

export function freshRotor(of: Rotor): RotorSettings {
  return {
    speed: of.speed, runUp: false, unbalance: 1, mass: 1, gap: 1, bias: 1, kp: 1, ki: 1, kd: 1, noise: 1, lag: 1, step: of.step[0], feedback: 0,
    filters: "extended,linear", assumed: 1, R: 1, Q: 1,
    delay: of.delay * of.T + of.delay_rest, push: Number((0.2 * of.mass * G).toPrecision(2)), seed: 1, noisy: true,
  };
}

/** Settings that differ from the machine's own, as the part of a link behind #. */
export function rotorToHash(settings: RotorSettings, own: RotorSettings, name: string): string {
  const parts = new URLSearchParams({ machine: name });
  for (const [key, value] of Object.entries(settings)) if (value !== own[key as keyof RotorSettings]) parts.set(key, String(value));
  return parts.toString();
}

/** The settings of a link; invalid ones are ignored. */
export function rotorFromHash(parts: URLSearchParams, machine: Rotor): Partial<RotorSettings> {
  const own = freshRotor(machine), out: Record<string, unknown> = {};
  for (const [key, text] of parts) {
    const known = own[key as keyof RotorSettings];
    if (typeof known === "number" && text !== "" && Number.isFinite(Number(text))) out[key] = Number(text);
    if (typeof known === "boolean") out[key] = text === "true";
    if (typeof known === "string" && kindsOf({ ...own, [key]: text }).length) out[key] = text;
  }
  return out as Partial<RotorSettings>;
}

function times(key: "unbalance" | "Q" | "R" | "mass" | "gap" | "bias" | "kp" | "ki" | "kd" | "noise" | "lag", group: string, label: string, by: number, help = ""): Knob<RotorSettings> {
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
    key: "step", group: "Sensors", label: "Quantisation", help: "Smallest step of the readings", unit: "m", get: (s) => s.step, set: (s, value) => (s.step = value),
    range: () => ({ from: 1e-2 * Math.sqrt(of.var_y[0]), to: 100 * Math.sqrt(of.var_y[0]), log: true, zero: true }),
  },
  {
    key: "delay", group: "Sensors", label: "Dead time", help: "From the sample to the current that it asks for", unit: "s",
    get: (s) => s.delay, set: (s, value) => (s.delay = value), range: () => ({ from: 0, to: 6 * of.T, log: false }),
  },
  {
    key: "assumed", group: "Filters", label: "Assumed k / true k", help: "How wrong the filters are about the magnets", unit: "1",
    get: (s: RotorSettings) => s.assumed, set: (s: RotorSettings, value: number) => (s.assumed = value), range: () => ({ from: 0.5, to: 1.6, log: false }),
  },
  times("R", "Filters", "R", 1e3, "Assumed variance of the measurements"),
  times("Q", "Filters", "Q", 1e4, "Assumed growth of the disturbance forces"),
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
  const lag = scaled(own.lag, s.lag), step = s.step === own.step[0] ? own.step : own.step.map(() => s.step);
  const controllers = (of: Controllers): Controllers => ({
    ...of, pid: of.pid.map(([kp, ki, kd, ...rest]) => [kp * s.kp, ki * s.ki, kd * s.kd, ...rest]), integral: same ? of.integral : held,
  });
  const { view } = own.filter, var_y = scaled(own.var_y, s.noise * s.noise);
  return {
    ...own, magnets, held, lag, step, var_y,
    B: s.mass === 1 ? own.B : rows(own.B),
    cosine: scaled(own.cosine, s.unbalance / s.mass),
    sine: scaled(own.sine, s.unbalance / s.mass),
    farthest: s.gap === 1 ? own.farthest : own.farthest.map((far, f) => {
      const clearance = view.clearance[f] ?? far;
      return clearance + 0.9 * Math.max(0, magnets[f][1] - clearance);
    }),
    substeps: Math.max(own.substeps, Math.ceil((2 * own.T) / Math.min(...lag))),
    delay: delayed ? whole : own.delay,
    delay_rest: delayed ? Math.max(0, samples - whole) * own.T : own.delay_rest,
    controllers: { measurement: controllers(own.controllers.measurement), estimate: controllers(own.controllers.estimate) },
    filter: {
      ...own.filter, lag: scaled(own.filter.lag, s.lag), f_0: scaled(own.filter.f_0, s.mass),
      view: { ...view, mass: scaled(view.mass, s.mass), lag: scaled(view.lag, s.lag), step, var_y: scaled(own.var_y, Math.max(s.noise, 0.02) ** 2) },
    },
  };
}

function scaled(of: number[], by: number): number[] {
  return by === 1 ? of : of.map((value) => value * by);
}

/** What filters know with these settings: speed, mass, lag and noise; a dead time other than the machine's own, and unbalance, not. */
export function assumed(own: Rotor, s: RotorSettings): Assumed {
  const { names, values } = own.filter, by: Record<string, number> = { mass: s.mass, transverse_inertia: s.mass, polar_inertia: s.mass };
  const parameters = names.map((name, k) => (name === "speed" ? s.speed : name.startsWith("lag_") ? values[k] * s.lag : values[k] * (by[name] ?? 1)));
  return { parameters, k: s.assumed, R: s.R, Q: s.Q };
}

/** The kinds that a rotor can have, and those that are set. */
export const ROTOR_KINDS = [0, 1, 2, 3, 4];

export function kindsOf(s: RotorSettings): number[] {
  return s.filters.split(",").map((name) => KINDS.findIndex((kind) => kind.name === name)).filter((kind) => ROTOR_KINDS.includes(kind)).slice(0, FILTERS);
}
