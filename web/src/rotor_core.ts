// A rotor on several bearings: its description is passed to C as consecutive numbers.

import { instance } from "./core";
import { grid, judged, type Sensitivity } from "./margins";

/** What filters are made of: web/core/model.c, filter.c. */
export interface RotorFilter {
  names: string[];
  values: number[];
  model: number[];
  view: Record<string, number[]>;
  lag: number[];
  f_0: number[];
  rest: number[];
  by_reading: number[][];
  displayed: number[][]; // displacements along the axes from the readings, and back
  added: number[][];
  loads: number; // index of the first disturbance force among the states
  along: number[][]; // displacements along the axes and velocities, from the states
  moving: number[][];
}

/** What filters assume, against the machine: magnet constants, R and Q. */
export interface Assumed {
  parameters: number[];
  k: number;
  R: number;
  Q: number;
}

/** Controllers of the axes, and what they see. */
export interface Controllers {
  pid: number[][];
  integral: number[];
  reference: number[];
  position: number[];
  velocity: number[] | null;
  spread: number[];
}

type Rows = [number[], number[], number[]];

/** What Python states of a rotor (src/ambkit/export/browser/parameters.py), in SI. */
export interface Rotor {
  positions: number; axes: number; sensors: number; states: number;
  T: number; delay: number; delay_rest: number; substeps: number;
  H: Rows; B: Rows; C: Rows; A: Rows; spin: number[];
  g: number[]; cosine: number[]; sine: number[]; bias: number[]; farthest: number[]; gain: number[]; lag: number[];
  magnets: number[][]; current: number[]; corner: number[]; behind: number[][]; shows: number[]; step: number[]; rings: number[][];
  k_ui: number[]; iu_min: number[]; iu_max: number[];
  controllers: { measurement: Controllers; estimate: Controllers };
  place: number[]; held: number[]; var_u: number[]; var_y: number[];
  speed: number; mass: number; names: string[];
  bearings: { name: string; place: number; angle: number; type: string }[];
  discs: number[];
  filter: RotorFilter;
  // positions along the shaft [m], and their motion as functions of the coordinates
  stations: number[];
  shape: { x: number[][]; y: number[][] };
  modes: number[]; // bending modes [Hz]
}

/** The numbers of a rotor in the order of web/core/rotor_description.c. */
export function numbers(of: Rotor, fed: boolean, assumed: Assumed, seed: number, noisy: boolean): number[] {
  const rows = (of: Rows) => of.flat(), axes = of.magnets.map((magnet, f) => [...magnet, of.current[f], of.corner[f], ...of.behind[f]]);
  const c = of.controllers[fed ? "estimate" : "measurement"], { filter } = of, p = of.axes, velocity = c.velocity ?? [];
  return [
    of.positions, of.axes, of.sensors, of.states, of.delay, of.delay_rest, of.substeps, of.T, seed, noisy ? 1 : 0,
    ...rows(of.H), ...rows(of.B), ...rows(of.C), ...rows(of.A), ...of.spin, ...of.g, ...of.cosine, ...of.sine, ...of.bias,
    ...of.farthest, ...of.gain, ...of.lag, ...axes.flat(), ...of.shows.flatMap((at, k) => [at, of.step[k]]),
    of.rings.length, ...of.rings.flat(), ...of.k_ui, ...of.iu_min, ...of.iu_max, ...c.pid.flat(), fed ? 1 : 0, c.position.length / p,
    ...c.reference, ...c.position, velocity.length / p, ...velocity, ...c.spread,
    ...of.place, ...of.held, ...c.integral, ...of.var_u, ...of.var_y,
    1, filter.view.travel.length, filter.rest.length, ...Object.values(filter.view).flat(), ...filter.lag, ...filter.f_0,
    assumed.k, assumed.R, assumed.Q, ...filter.rest, ...filter.by_reading.flat(), ...filter.displayed.flat(), ...filter.added.flat(),
  ];
}

/** What a filter makes of a flight. */
export interface RotorHistory {
  kind: number;
  states: number;
  mean: Float64Array;
  cov: Float64Array | null; // of the first
  innovation: Float64Array;
  variance: Float64Array;
}

export interface RotorFlight {
  n: number;
  T: number;
  q: Float64Array[]; // coordinates of the rotor
  iu: Float64Array; // n x axes
  force: Float64Array;
  y: Float64Array;
  u: Float64Array;
  speed: Float64Array; // n + 1
  atStop: Uint8Array;
  filters: RotorHistory[];
}

/** A moment of the rotor under the hand, along its axes. */
export interface RotorLive {
  s: number[];
  v: number[];
  iu: number[];
  force: number[];
  cosine: number;
  sine: number;
  q: number[]; // positions
}

interface Exports {
  memory: WebAssembly.Memory;
  description(): number;
  read_rotor(): void;
  model_input(): number;
  read_model(): void;
  history(filter: number, which: number): number;
  frequencies(answered: number): number;
  rotor_series(which: number): number;
  rotor_fly(samples: number, kind: number): number;
  rotor_estimate(samples: number, filter: number, kind: number): number;
  rotor_sensitivity(axis: number, kind: number, speed: number): number;
  gains(points: number): void;
  live_push(): number;
  rotor_live_set(kind: number, anew: number): void;
  rotor_live_step(n: number, speed: number, off: number): number;
}

export const MOST_ROTOR_SAMPLES = 10001;

export class RotorCore {
  private of!: Rotor;
  private model: number[] | null = null;

  private constructor(private readonly c: Exports) {}

  static async of(wasm: BufferSource): Promise<RotorCore> {
    return new RotorCore(await instance<Exports>(wasm));
  }

  private reals(at: number, n: number): Float64Array {
    return new Float64Array(this.c.memory.buffer, at, n);
  }

  take(of: Rotor, fed: boolean, assumed: Assumed, seed: number, noisy: boolean): void {
    const all = numbers(of, fed, assumed, seed, noisy), { model } = of.filter;
    this.of = of;
    this.reals(this.c.description(), all.length).set(all);
    this.c.read_rotor();
    if (model !== this.model) {
      this.reals(this.c.model_input(), model.length).set(model);
      this.c.read_model();
      this.model = model;
    }
    this.reals(this.c.rotor_series(9), assumed.parameters.length).set(assumed.parameters);
  }

  /** Fly with loads (n x axes) [N] at speeds (n + 1) [rad/s], the first of the filters in the loop; null: it cannot be made. */
  fly(load: Float64Array, speed: Float64Array, kinds: number[]): RotorFlight | null {
    const { axes, sensors, positions, T } = this.of, n = load.length / axes;
    const at = (which: number, count: number) => this.reals(this.c.rotor_series(which), count);
    at(0, n * axes).fill(0);
    at(1, n * axes).set(load);
    at(2, n + 1).set(speed);
    const states = this.c.rotor_fly(n, kinds[0] ?? -1);
    if (states < 0) return null;
    kinds.slice(1).forEach((kind, j) => this.c.rotor_estimate(n, j + 1, kind));
    const pairs = (states * (states + 1)) / 2, columns = this.c.rotor_series(3);
    return {
      n, T, q: Array.from({ length: 2 * positions }, (_, j) => this.reals(columns + 8 * j * MOST_ROTOR_SAMPLES, n)),
      iu: at(4, n * axes), force: at(5, n * axes), y: at(6, n * sensors), u: at(7, n * axes), speed: at(2, n + 1),
      atStop: new Uint8Array(this.c.memory.buffer, this.c.rotor_series(8), n),
      filters: (states > 0 ? kinds : []).map((kind, j) => {
        const of = (which: number, width: number) => this.reals(this.c.history(j, which), n * width);
        return { kind, states, mean: of(0, states), cov: j === 0 && n * pairs <= MOST_PAIRS ? of(1, pairs) : null, innovation: of(2, sensors), variance: of(3, sensors) };
      }),
    };
  }

  /** |S| along an axis of the loop at rest at a speed [rad/s], with a filter of this kind. */
  sensitivity(axis: number, kind: number, speed: number, points = 200): Sensitivity | null {
    const [k, s0, i0] = this.of.magnets[axis], stiffness = (4 * k * i0 * i0) / s0 ** 3;
    const f = grid(Math.sqrt(stiffness / this.of.filter.view.mass[axis]), this.of.T, points);
    const stable = this.c.rotor_sensitivity(axis, kind, speed);
    return stable < 0 ? null : judged(f, stable > 0, (at) => {
      this.reals(this.c.frequencies(0), at.length).set(at);
      this.c.gains(at.length);
      return [...this.reals(this.c.frequencies(1), at.length)];
    });
  }

  /** Under the hand; `anew`: from the middle. */
  start(kind: number, anew: boolean): void {
    this.c.rotor_live_set(kind, anew ? 1 : 0);
  }

  step(n: number, speed: number, off: boolean, push: number[]): RotorLive {
    const p = this.of.axes;
    this.reals(this.c.live_push(), p).set(push);
    const all = [...this.reals(this.c.rotor_live_step(n, speed, off ? 1 : 0), 4 * p + 2 + this.of.positions)];
    const part = (k: number) => all.slice(k * p, (k + 1) * p);
    return { s: part(0), v: part(1), iu: part(2), force: part(3), cosine: all[4 * p], sine: all[4 * p + 1], q: all.slice(4 * p + 2) };
  }
}

const MOST_PAIRS = 6000000; // of web/core/bench.h

/** Displacements along axis f over a flight [m], or velocities [m/s]. */
export function along(of: Rotor, flight: RotorFlight, f: number, velocities = false): Float64Array {
  const [start, column, value] = of.H, to = new Float64Array(flight.n), first = velocities ? of.positions : 0;
  for (let j = start[f]; j < start[f + 1]; j++) {
    const by = value[j], q = flight.q[first + column[j]];
    for (let k = 0; k < flight.n; k++) to[k] += by * q[k];
  }
  return to;
}

/** The same of an estimate, by rows over its states. */
export function estimated(row: number[], of: RotorHistory, n: number): Float64Array {
  const to = new Float64Array(n), { mean, states } = of;
  row.forEach((by, j) => {
    if (by !== 0) for (let k = 0; k < n; k++) to[k] += by * mean[k * states + j];
  });
  return to;
}
