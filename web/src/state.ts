// All settings as one object; a link contains those that differ from the machine's own.

import { ADAPTIVE, KINDS, type Parameters } from "./core";
import type { Rotor } from "./rotor_core";

/** A machine as the page receives it: from Python, or from a dropped file. */
export interface Machine {
  name: string;
  description: string;
  axis: Parameters; // of a machine with one axis; else empty
  expert?: number[]; // rules of the paper's network for it, in the form of web/core/axis.h
  rotor?: Rotor;
}

export type Start = "levitated" | "landed" | "released";
export const STARTS: Start[] = ["levitated", "landed", "released"];

export interface Settings {
  machine: Machine;
  p: Parameters; // of the axis, changed by controls
  kinds: number[]; // up to four; the first is in the loop
  R: number; // of the filters, relative to their own [1]
  Q: number;
  reference: number; // step height [m]
  push: number; // step of the disturbance force [N]
  duration: number; // [s]
  start: Start;
  seed: number;
  noisy: boolean;
}

export const FILTERS = 4;

/** The default settings of a machine. */
export function fresh(machine: Machine): Settings {
  const p = { ...machine.axis };
  const two = p.two_sided > 0;
  return {
    machine, p, kinds: [2, 0, machine.expert ? ADAPTIVE : 1, 5], R: 1, Q: 1,
    reference: 0.1 * p.clearance,
    push: -tidy(0.3 * Math.max(Math.abs(p.gravity) * p.mass * 9.81, two ? 0.1 * 4 * p.k * p.i0 * p.i0 / p.s0 ** 2 : 0)),
    duration: Math.min(0.5 * Math.ceil(5000 * p.T / 0.5), 20000 * p.T) || 5000 * p.T,
    start: "levitated", seed: 1, noisy: true,
  };
}

/** A number in plain notation. */
export function tidy(value: number): number {
  return Number(value.toPrecision(2));
}

const PLAIN = ["R", "Q", "reference", "push", "duration", "seed"] as const;

/** Settings that differ from the machine's own, as the part of a link behind #. */
export function toHash(s: Settings, known: Machine[]): string {
  const of = fresh(s.machine), parts = new URLSearchParams();
  if (known.some((machine) => machine.name === s.machine.name && same(machine, s.machine))) parts.set("machine", s.machine.name);
  else parts.set("own", JSON.stringify(s.machine));
  for (const [key, value] of Object.entries(s.p)) if (value !== of.p[key]) parts.set(`p.${key}`, String(value));
  for (const key of PLAIN) if (s[key] !== of[key]) parts.set(key, String(s[key]));
  if (s.start !== of.start) parts.set("start", s.start);
  if (!s.noisy) parts.set("noise", "off");
  if (String(s.kinds) !== String(of.kinds)) parts.set("filters", s.kinds.map((kind) => KINDS[kind].name).join(","));
  return parts.toString();
}

function same(a: Machine, b: Machine): boolean {
  return JSON.stringify(a.axis) === JSON.stringify(b.axis);
}

/** The settings of a link; invalid ones keep their defaults. */
export function fromHash(hash: string, known: Machine[]): Settings | null {
  const parts = new URLSearchParams(hash.replace(/^#/, ""));
  let machine = known.find((one) => one.name === parts.get("machine"));
  if (parts.has("own")) machine = checked(parts.get("own")) ?? machine;
  if (!machine) return null;
  const s = fresh(machine);
  for (const [key, text] of parts) {
    const value = Number(text);
    if (key.startsWith("p.") && key.slice(2) in s.p && Number.isFinite(value)) s.p[key.slice(2)] = value;
    for (const plain of PLAIN) if (key === plain && text !== "" && Number.isFinite(value)) s[plain] = value;
  }
  s.duration = Math.min(Math.max(s.duration, 100 * s.p.T), 20000 * s.p.T);
  const start = STARTS.find((one) => one === parts.get("start"));
  if (start) s.start = start;
  s.noisy = parts.get("noise") !== "off";
  const kinds = (parts.get("filters") ?? "").split(",").map((name) => KINDS.findIndex((kind) => kind.name === name));
  if (kinds.every((kind) => kind >= 0 && (kind !== ADAPTIVE || machine.expert))) s.kinds = kinds.slice(0, FILTERS);
  return s;
}

function checked(text: string | null): Machine | undefined {
  try {
    const machine = JSON.parse(text ?? "") as Machine;
    const numbers = Object.values(machine.axis).every((value) => Number.isFinite(value));
    // without its expert system
    return numbers ? { name: String(machine.name), description: String(machine.description), axis: machine.axis } : undefined;
  } catch {
    return undefined;
  }
}

/** The parameters of the C code for these settings. */
export function parameters(s: Settings, own: { R: number; Q: number }): Parameters {
  return {
    ...s.p,
    filter_R: s.R === 1 ? 0 : s.R * own.R,
    filter_Q: s.Q === 1 ? 0 : s.Q * own.Q,
    seed: s.seed, noisy: s.noisy ? 1 : 0, start: STARTS.indexOf(s.start),
  };
}

/** Reference and load of the run: a step of each, at a tenth and at half of it. */
export function signals(s: Settings): { r: Float64Array; load: Float64Array } {
  const n = Math.max(2, Math.round(s.duration / s.p.T) + 1);
  const r = new Float64Array(n), load = new Float64Array(n);
  r.fill(s.reference, Math.round(n / 10));
  load.fill(s.push, Math.round(n / 2));
  return { r, load };
}
