// The C code of ambkit in the page: parameters by name, results as views of its memory.

export interface Exports {
  memory: WebAssembly.Memory;
  _initialize?(): void;
  names(): number;
  parameters(): number;
  expert(): number;
  series(which: number): number;
  history(filter: number, which: number): number;
  fly(kind: number): number;
  estimate(filter: number, kind: number): number;
  magnet_at(current: number, x: number): number;
  levitation(x: number, load: number): number;
  assumed(): number;
  model_input(): number;
  read_model(): void;
  set_share(share: number): void;
  frequencies(answered: number): number;
  sensitivity(kind: number): number;
  gains(points: number): void;
  live_set(kind: number, anew: number): number;
  live_step(n: number, reference: number, push: number, off: number): number;
}

export type Parameters = Record<string, number>;

/** The estimator kinds in the order of web/core/axis.h. */
export const KINDS = [
  { name: "linear", label: "Linear Kalman filter", short: "linear" },
  { name: "closed-law", label: "Adaptive Kalman filter, closed law", short: "closed law" },
  { name: "extended", label: "Extended Kalman filter", short: "extended" },
  { name: "unscented", label: "Unscented Kalman filter", short: "unscented" },
  { name: "ud", label: "UD-factorised Kalman filter", short: "UD" },
  { name: "low-pass", label: "Low-pass and derivative", short: "low-pass" },
  { name: "adaptive", label: "Adaptive Kalman filter, fuzzy expert", short: "fuzzy expert" },
] as const;

/** The kind whose rules are trained in Python for each machine. */
export const ADAPTIVE = KINDS.length - 1;

export const MOST_SAMPLES = 20001;

export interface History {
  kind: number;
  states: number; // x, v, f_d, x_m, and the delayed states: current, past controls
  mean: Float64Array; // n x states
  cov: Float64Array; // n x triangle, of the first filter
  innovation: Float64Array;
  variance: Float64Array;
  k_i: Float64Array;
  k_s: Float64Array;
}

export interface Flight {
  n: number;
  T: number;
  r: Float64Array;
  load: Float64Array;
  x: Float64Array;
  v: Float64Array;
  iu: Float64Array;
  force: Float64Array;
  y: Float64Array;
  u: Float64Array;
  atStop: Uint8Array;
  filters: History[];
}

/** State of the interactive rotor after a step. */
export interface Live {
  x: number;
  v: number;
  iu: number;
  force: number;
  y: number;
  x_hat: number;
  v_hat: number;
  f_d_hat: number;
  f_d_var: number;
  samples: number;
}

/** An instance of the C code with its own memory. */
export async function instance<T>(wasm: BufferSource): Promise<T> {
  const nothing = new Proxy({}, { get: () => () => 0 });
  const made = await WebAssembly.instantiate(wasm, { wasi_snapshot_preview1: nothing });
  (made.instance.exports as { _initialize?(): void })._initialize?.();
  return made.instance.exports as T;
}

/** Samples of dead time that the page's filter models support, each with and without an amplifier bandwidth. */
const MOST_PAST = 3;

export class Core {
  readonly names: string[];
  private readonly memory: WebAssembly.Memory;
  private model = -1;

  private constructor(private readonly c: Exports, private readonly models: number[][]) {
    this.memory = c.memory;
    const bytes = new Uint8Array(this.memory.buffer, c.names());
    this.names = new TextDecoder().decode(bytes.slice(0, bytes.indexOf(0))).trim().split(" ");
  }

  static async of(wasm: BufferSource, models: number[][]): Promise<Core> {
    return new Core(await instance<Exports>(wasm), models);
  }

  private reals(at: number, n: number): Float64Array {
    return new Float64Array(this.memory.buffer, at, n);
  }

  state(parameters: Parameters): void {
    const to = this.reals(this.c.parameters(), this.names.length);
    this.names.forEach((name, k) => (to[k] = parameters[name] ?? 0));
    this.lag(parameters);
  }

  /** The filters' model has states for dead time and bandwidth. */
  private lag({ delay, T, bandwidth }: Parameters): void {
    const samples = delay / T, past = Math.ceil(samples - 1e-9), model = 2 * Math.min(past, MOST_PAST) + (bandwidth > 0 ? 1 : 0);
    if (model !== this.model) {
      this.reals(this.c.model_input(), this.models[model].length).set(this.models[model]);
      this.c.read_model();
      this.model = model;
    }
    this.c.set_share(Math.min(samples - (past - 1), 1));
  }

  /** The rules of the machine's expert system; without rules there is no adaptive filter. */
  setExpert(numbers: number[] | undefined): void {
    this.reals(this.c.expert(), 1)[0] = 0;
    if (numbers) this.reals(this.c.expert(), numbers.length).set(numbers);
  }

  /** Run with these references [m] and loads [N]; the first kind is in the loop. */
  fly(parameters: Parameters, r: Float64Array, load: Float64Array, kinds: number[]): Flight | null {
    const n = r.length;
    this.state({ ...parameters, samples: n, reference: r[0], load: load[0] });
    const at = (which: number) => this.reals(this.c.series(which), n);
    at(0).set(r);
    at(1).set(load);
    const states = this.c.fly(kinds[0]);
    if (!states) return null;
    for (let j = 1; j < kinds.length; j++) if (!this.c.estimate(j, kinds[j])) return null;
    return {
      n, T: parameters.T, r: at(0), load: at(1), x: at(4), v: at(5), iu: at(7), force: at(8),
      y: at(9), u: at(10), atStop: new Uint8Array(this.memory.buffer, this.c.series(11), n),
      filters: this.histories(kinds, n, states),
    };
  }

  /** Run filters over a record of readings y [m] and controls u [V]. */
  filter(parameters: Parameters, y: Float64Array, u: Float64Array, kinds: number[]): History[] | null {
    this.state({ ...parameters, samples: y.length });
    this.reals(this.c.series(9), y.length).set(y);
    this.reals(this.c.series(10), y.length).set(u);
    const states = kinds.map((kind, j) => this.c.estimate(j, kind));
    return states.every((n) => n > 0) ? this.histories(kinds, y.length, states[0]) : null;
  }

  private histories(kinds: number[], n: number, states: number): History[] {
    return kinds.map((kind, j) => {
      const at = (which: number, width: number) => this.reals(this.c.history(j, which), n * width);
      return {
        kind, states, mean: at(0, states), cov: at(1, (states * (states + 1)) / 2), innovation: at(2, 1), variance: at(3, 1),
        k_i: at(4, 1), k_s: at(5, 1),
      };
    });
  }

  /** Force [N], k_i [N/A] and k_s [N/m] of the magnet. */
  magnet(iu: number, x: number): { force: number; k_i: number; k_s: number } {
    const [force, k_i, k_s] = this.reals(this.c.magnet_at(iu, x), 3);
    return { force, k_i, k_s };
  }

  levitation(x: number, load: number): number {
    return this.c.levitation(x, load);
  }

  /** Default R [m^2] and Q [N^2/s] of the filters. */
  assumed(): { R: number; Q: number } {
    const [R, Q] = this.reals(this.c.assumed(), 2);
    return { R, Q };
  }

  /** Apply a small pulse to the loop: whether it is stable; null: no filter is possible. */
  sensitivity(kind: number): boolean | null {
    const stable = this.c.sensitivity(kind);
    return stable < 0 ? null : stable > 0;
  }

  /** |S| from its response, at frequencies f [Hz]. */
  gains(f: number[]): number[] {
    this.reals(this.c.frequencies(0), f.length).set(f);
    this.c.gains(f.length);
    return [...this.reals(this.c.frequencies(1), f.length)];
  }

  liveSet(kind: number, anew: boolean): boolean {
    return this.c.live_set(kind, anew ? 1 : 0) !== 0;
  }

  liveStep(n: number, reference: number, push: number, off: boolean): Live {
    const [x, v, iu, force, y, x_hat, v_hat, f_d_hat, f_d_var, samples] = this.reals(
      this.c.live_step(n, reference, push, off ? 1 : 0), 10);
    return { x, v, iu, force, y, x_hat, v_hat, f_d_hat, f_d_var, samples };
  }
}
