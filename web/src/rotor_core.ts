// A rotor on several bearings: its description goes to C as numbers one after the other.

/** What a filter is made of: web/core/rotor/filter.c. */
export interface RotorFilter {
  names: string[];
  values: number[];
  pattern: number[];
  plan: number[];
  settings: Record<string, number[]>;
  dwell: number;
  std: number[];
  start: number[];
  loads: number; // the first state that is a disturbance force
}

/** Which filter is over the readings, with which parameters, and by what it takes the magnets too strong. */
export interface Filtering {
  kind: 0 | 1 | 2; // none, linear, extended
  of: RotorFilter;
  parameters: number[];
  k: number;
}

type Rows = [number[], number[], number[]];

/** What Python states of a rotor (src/ambkit/export/browser/rotor.py), in SI. */
export interface Rotor {
  positions: number; axes: number; sensors: number; states: number;
  T: number; delay: number; delay_rest: number; substeps: number;
  H: Rows; B: Rows; C: Rows; A: Rows; spin: number[];
  g: number[]; cosine: number[]; sine: number[]; bias: number[]; farthest: number[]; gain: number[]; lag: number[];
  magnets: number[][]; current: number[]; corner: number[]; shows: number[]; step: number[]; rings: number[][];
  k_ui: number[]; iu_min: number[]; iu_max: number[]; pid: number[][];
  reference: number[][] | number[]; position: number[][] | number[]; spread: number[][] | number[];
  place: number[]; held: number[]; integral: number[]; var_u: number[]; var_y: number[];
  speed: number; mass: number; names: string[];
  bearings: { name: string; place: number; angle: number; type: string }[];
  discs: number[];
  filter: RotorFilter | null;
}

/** The numbers of a rotor in the order of web/core/rotor/rotor.c. */
export function numbers(of: Rotor, seed: number, noisy: boolean): number[] {
  const rows = (of: Rows) => of.flat(), axes = of.magnets.map((magnet, f) => [...magnet, of.current[f], of.corner[f]]);
  return [
    of.positions, of.axes, of.sensors, of.states, of.delay, of.delay_rest, of.substeps, of.T, seed, noisy ? 1 : 0,
    ...rows(of.H), ...rows(of.B), ...rows(of.C), ...rows(of.A), ...of.spin, ...of.g, ...of.cosine, ...of.sine, ...of.bias,
    ...of.farthest, ...of.gain, ...of.lag, ...axes.flat(), ...of.shows.flatMap((at, k) => [at, of.step[k]]),
    of.rings.length, ...of.rings.flat(), ...of.k_ui, ...of.iu_min, ...of.iu_max, ...of.pid.flat(),
    ...(of.reference as number[]).flat(), ...(of.position as number[]).flat(), ...(of.spread as number[]).flat(),
    ...of.place, ...of.held, ...of.integral, ...of.var_u, ...of.var_y,
  ];
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
  filter: { states: number; mean: Float64Array; innovation: Float64Array; variance: Float64Array } | null;
}

/** A moment of the rotor under the hand, along its axes. */
export interface RotorLive {
  s: number[];
  v: number[];
  iu: number[];
  force: number[];
  cosine: number;
  sine: number;
}

interface Exports {
  memory: WebAssembly.Memory;
  _initialize?(): void;
  description(): number;
  read(): void;
  series(which: number): number;
  fly(samples: number, kind: number, k: number): number;
  filter_input(): number;
  filter_parameters(): number;
  read_filter(): void;
  filter_history(which: number): number;
  live_push(): number;
  live_start(): void;
  live_step(n: number, speed: number, off: number): number;
}

export const MOST_ROTOR_SAMPLES = 10001;

export class RotorCore {
  private of!: Rotor;

  private constructor(private readonly c: Exports) {
    c._initialize?.();
  }

  static async of(wasm: BufferSource): Promise<RotorCore> {
    const nothing = new Proxy({}, { get: () => () => 0 });
    const { instance } = await WebAssembly.instantiate(wasm, { wasi_snapshot_preview1: nothing });
    return new RotorCore(instance.exports as unknown as Exports);
  }

  private reals(at: number, n: number): Float64Array {
    return new Float64Array(this.c.memory.buffer, at, n);
  }

  take(of: Rotor, seed: number, noisy: boolean): void {
    const all = numbers(of, seed, noisy);
    this.of = of;
    this.reals(this.c.description(), all.length).set(all);
    this.c.read();
  }

  /** Fly with loads (n x axes) [N] at speeds (n + 1) [rad/s]. */
  fly(load: Float64Array, speed: Float64Array, filtering: Filtering | null = null): RotorFlight {
    const { axes, sensors, positions, T } = this.of, n = load.length / axes;
    const at = (which: number, count: number) => this.reals(this.c.series(which), count);
    at(0, n * axes).fill(0);
    at(1, n * axes).set(load);
    at(2, n + 1).set(speed);
    if (filtering) {
      const { of } = filtering, all = [...of.pattern, ...of.plan, ...Object.values(of.settings).flat(), of.dwell, ...of.std, ...of.start];
      this.reals(this.c.filter_input(), all.length).set(all);
      this.c.read_filter();
      this.reals(this.c.filter_parameters(), filtering.parameters.length).set(filtering.parameters);
    }
    const filtered = this.c.fly(n, filtering?.kind ?? 0, filtering?.k ?? 1) > 0, states = filtering?.of.std.length ?? 0;
    const history = (which: number, count: number) => this.reals(this.c.filter_history(which), count);
    const columns = this.c.series(3);
    return {
      n, T, q: Array.from({ length: 2 * positions }, (_, j) => this.reals(columns + 8 * j * MOST_ROTOR_SAMPLES, n)),
      iu: at(4, n * axes), force: at(5, n * axes), y: at(6, n * sensors), u: at(7, n * axes), speed: at(2, n + 1),
      atStop: new Uint8Array(this.c.memory.buffer, this.c.series(8), n),
      filter: filtered ? { states, mean: history(0, n * states), innovation: history(1, n * sensors), variance: history(2, n * sensors) } : null,
    };
  }

  start(): void {
    this.c.live_start();
  }

  step(n: number, speed: number, off: boolean, push: number[]): RotorLive {
    const p = this.of.axes;
    this.reals(this.c.live_push(), p).set(push);
    const all = [...this.reals(this.c.live_step(n, speed, off ? 1 : 0), 4 * p + 2)];
    const part = (k: number) => all.slice(k * p, (k + 1) * p);
    return { s: part(0), v: part(1), iu: part(2), force: part(3), cosine: all[4 * p], sine: all[4 * p + 1] };
  }
}

/** Displacements along axis f over a flight [m]. */
export function along(of: Rotor, flight: RotorFlight, f: number): Float64Array {
  const [start, column, value] = of.H, to = new Float64Array(flight.n);
  for (let k = 0; k < flight.n; k++) {
    let sum = 0;
    for (let j = start[f]; j < start[f + 1]; j++) sum += value[j] * flight.q[column[j]][k];
    to[k] = sum;
  }
  return to;
}
