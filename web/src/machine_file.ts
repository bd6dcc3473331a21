// A machine with one axis from its TOML file, and the settings as such a file.

import type { Machine, Settings } from "./state";
import { string, type Table } from "./toml";
import { quantity } from "./units";

const MU_0 = 1.25663706127e-6;
const GRAVITY: Record<string, number> = { "-x": -1, "+x": 1, none: 0 };

/** The keys supported by the page; others are listed as not simulated. */
const KNOWN: Record<string, string[]> = {
  "": ["name", "description", "source", "sampling_time", "delay", "speed", "magnet", "rotor", "amplifier", "sensor"],
  magnet: ["type", "magnet_constant", "turns", "pole_area", "pole_angle", "air_gap", "bias_current"],
  rotor: ["mass", "gravity", "clearance"],
  amplifier: ["gain", "current_limit", "noise_variance", "bandwidth"],
  sensor: ["gain", "lag", "noise_variance", "quantisation"],
};

/** A machine, and the keys of its file that the page does not simulate. */
export function machineOf(table: Table): { machine: Machine; left: string[] } {
  if (Array.isArray(table.bearing) || Array.isArray(table.sensor))
    throw new Error("a machine with several axes comes into the page by Python: ambkit workbench FILE.toml");
  const part = (name: string) => {
    const of = table[name];
    if (typeof of !== "object" || Array.isArray(of)) throw new Error(`there is no [${name}]`);
    return of;
  };
  const left: string[] = [];
  for (const [name, keys] of Object.entries(KNOWN))
    for (const key of Object.keys(name ? part(name) : table)) if (!keys.includes(key)) left.push(name ? `${name}.${key}` : key);
  const number = (name: string, key: string, otherwise?: number): number => {
    const value = name ? part(name)[key] : table[key];
    if (value === undefined && otherwise !== undefined) return otherwise;
    if (value === undefined) throw new Error(`${name ? `${name}.` : ""}${key} is missing`);
    try {
      return quantity(value);
    } catch (error) {
      throw new Error(`${name}.${key}: ${(error as Error).message}`);
    }
  };
  const magnet = part("magnet"), direction = part("rotor").gravity;
  const turned = magnet.turns !== undefined;
  const axis = {
    T: number("", "sampling_time"), mass: number("rotor", "mass"),
    gravity: String(direction) in GRAVITY ? GRAVITY[String(direction)] : -Math.cos(quantity(direction)),
    clearance: number("rotor", "clearance"),
    k: turned
      ? (MU_0 * number("magnet", "pole_area") * number("magnet", "turns") ** 2) / 4 * Math.cos(number("magnet", "pole_angle", 0))
      : number("magnet", "magnet_constant"),
    s0: number("magnet", "air_gap"), i0: number("magnet", "bias_current"), two_sided: magnet.type === "two-sided" ? 1 : 0,
    gain: number("amplifier", "gain"), current_limit: number("amplifier", "current_limit"),
    noise_u: number("amplifier", "noise_variance"), bandwidth: number("amplifier", "bandwidth", 0), delay: number("", "delay", 0),
    K_sen: number("sensor", "gain"), lag: number("sensor", "lag"), noise_y: number("sensor", "noise_variance"),
    step: number("sensor", "quantisation", 0),
    kp: 0, ki: 0, kd: 0, T_f: 0, T_t: 0, weight: 0.5, feedback: 1, filter_k: 1,
  };
  for (const key of ["T", "mass", "clearance", "k", "s0", "i0", "current_limit", "lag", "noise_y"] as const)
    if (!(axis[key] > 0)) throw new Error(`${key} must be greater than 0, is ${axis[key]}`);
  if (!(axis.clearance < axis.s0)) throw new Error("rotor.clearance must be less than magnet.air_gap");
  return { machine: { name: String(table.name ?? "dropped"), description: String(table.description ?? ""), axis }, left };
}

/** The settings as a machine file that Python can load; its link restores the page's other settings. */
export function toToml(s: Settings, hash: string): string {
  const p = s.p, line = (key: string, value: number, unit: string) => `${key} = "${value} ${unit}"`;
  const direction = Object.entries(GRAVITY).find(([, share]) => share === p.gravity)?.[0];
  const controller = { kp: "A/m", ki: "A/(m s)", kd: "A s/m", derivative_filter: "s", anti_windup: "s" };
  const gains = [p.kp, p.ki, p.kd, p.T_f, p.T_t];
  return [
    `# Settings of the ambkit workbench; drop this file onto the page to go on. It is a machine for ambkit, too:`,
    `#   ambkit simulate THIS.toml`,
    `# workbench: ${hash}`,
    `# controller: ${Object.entries(controller).map(([key, unit], k) => `${key} = "${gains[k]} ${unit}"`).join(", ")}, setpoint_weight = ${p.weight}`,
    "",
    `name = ${string(s.machine.name)}`,
    `description = ${string(s.machine.description)}`,
    line("sampling_time", p.T, "s"),
    ...(p.delay > 0 ? [line("delay", p.delay, "s")] : []),
    "",
    "[magnet]",
    `type = "${p.two_sided > 0 ? "two-sided" : "one-sided"}"`,
    line("magnet_constant", p.k, "N m^2/A^2"),
    line("air_gap", p.s0, "m"),
    line("bias_current", p.i0, "A"),
    "",
    "[rotor]",
    line("mass", p.mass, "kg"),
    `gravity = ${direction ? `"${direction}"` : `"${Math.acos(-p.gravity)} rad"`}`,
    line("clearance", p.clearance, "m"),
    "",
    "[amplifier]",
    line("gain", p.gain, "A/V"),
    line("current_limit", p.current_limit, "A"),
    line("noise_variance", p.noise_u, "V^2"),
    ...(p.bandwidth > 0 ? [line("bandwidth", p.bandwidth, "Hz")] : []),
    "",
    "[sensor]",
    `gain = ${p.K_sen}`,
    line("lag", Math.max(p.lag, 1e-3 * p.T), "s"),
    line("noise_variance", p.noise_y, "m^2"),
    ...(p.step > 0 ? [line("quantisation", p.step, "m")] : []),
    "",
  ].join("\n");
}
