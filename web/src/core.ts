// The C of ambkit in the page: parameters go in by name, series come out as views of its memory.

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
  linearised(parameters: number, kind: number, current: number, x: number): number;
  rates(): number;
  transition(time: number): number;
  live_set(kind: number, anew: number): number;
  live_step(n: number, reference: number, push: number, off: number): number;
}

export type Parameters = Record<string, number>;

/** The kinds of estimators in the order of web/core/axis.h. */
export const KINDS = [
  { name: "linear", label: "Linear Kalman filter", short: "linear" },
  { name: "closed-law", label: "Adaptive Kalman filter, closed law", short: "closed law" },
  { name: "extended", label: "Extended Kalman filter", short: "extended" },
  { name: "unscented", label: "Unscented Kalman filter", short: "unscented" },
  { name: "ud", label: "UD-factorised Kalman filter", short: "UD" },
  { name: "low-pass", label: "Low-pass and derivative", short: "low-pass" },
  { name: "adaptive", label: "Adaptive Kalman filter, fuzzy expert", short: "fuzzy expert" },
] as const;

/** The kind whose rules are learned in Python, machine by machine. */
export const ADAPTIVE = KINDS.length - 1;

export const MOST_SAMPLES = 20001;

export interface History {
  kind: number;
  mean: Float64Array; // n x 4
  cov: Float64Array; // n x 10
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

/** What the rotor under the hand shows after a step. */
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

export class Core {
  readonly names: string[];
  private readonly memory: WebAssembly.Memory;

  private constructor(private readonly c: Exports) {
    this.memory = c.memory;
    c._initialize?.();
    const bytes = new Uint8Array(this.memory.buffer, c.names());
    this.names = new TextDecoder().decode(bytes.slice(0, bytes.indexOf(0))).trim().split(" ");
  }

  static async of(wasm: BufferSource): Promise<Core> {
    const nothing = new Proxy({}, { get: () => () => 0 });
    const { instance } = await WebAssembly.instantiate(wasm, { wasi_snapshot_preview1: nothing });
    return new Core(instance.exports as unknown as Exports);
  }

  private reals(at: number, n: number): Float64Array {
    return new Float64Array(this.memory.buffer, at, n);
  }

  state(parameters: Parameters): void {
    const to = this.reals(this.c.parameters(), this.names.length);
    this.names.forEach((name, k) => (to[k] = parameters[name] ?? 0));
  }

  /** The rules of the machine's expert; without any there is no adaptive filter with one. */
  setExpert(numbers: number[] | undefined): void {
    this.reals(this.c.expert(), 1)[0] = 0;
    if (numbers) this.reals(this.c.expert(), numbers.length).set(numbers);
  }

  /** Fly with these references [m] and loads [N]; the first kind is in the loop. */
  fly(parameters: Parameters, r: Float64Array, load: Float64Array, kinds: number[]): Flight | null {
    const n = r.length;
    this.state({ ...parameters, samples: n, reference: r[0], load: load[0] });
    const at = (which: number) => this.reals(this.c.series(which), n);
    at(0).set(r);
    at(1).set(load);
    if (!this.c.fly(kinds[0])) return null;
    for (let j = 1; j < kinds.length; j++) if (!this.c.estimate(j, kinds[j])) return null;
    return {
      n, T: parameters.T, r: at(0), load: at(1), x: at(4), v: at(5), iu: at(7), force: at(8),
      y: at(9), u: at(10), atStop: new Uint8Array(this.memory.buffer, this.c.series(11), n),
      filters: this.histories(kinds, n),
    };
  }

  /** Filters over a record of readings y [m] and controls u [V]. */
  filter(parameters: Parameters, y: Float64Array, u: Float64Array, kinds: number[]): History[] | null {
    this.state({ ...parameters, samples: y.length });
    this.reals(this.c.series(9), y.length).set(y);
    this.reals(this.c.series(10), y.length).set(u);
    for (let j = 0; j < kinds.length; j++) if (!this.c.estimate(j, kinds[j])) return null;
    return this.histories(kinds, y.length);
  }

  private histories(kinds: number[], n: number): History[] {
    return kinds.map((kind, j) => {
      const at = (which: number, width: number) => this.reals(this.c.history(j, which), n * width);
      return {
        kind, mean: at(0, 4), cov: at(1, 10), innovation: at(2, 1), variance: at(3, 1),
        k_i: at(4, 1), k_s: at(5, 1),
      };
    });
  }

  /** Force [N], k_i [N/A] and k_s [N/m] of the stated magnet. */
  magnet(iu: number, x: number): { force: number; k_i: number; k_s: number } {
    const [force, k_i, k_s] = this.reals(this.c.magnet_at(iu, x), 3);
    return { force, k_i, k_s };
  }

  levitation(x: number, load: number): number {
    return this.c.levitation(x, load);
  }

  /** R [m^2] and Q [N^2/s] that filters assume. */
  assumed(): { R: number; Q: number } {
    const [R, Q] = this.reals(this.c.assumed(), 2);
    return { R, Q };
  }

  linearised(kind: number, iu: number, x: number): { A: number[]; B: number[]; K: number[]; k_i: number; k_s: number } | null {
    const at = this.c.linearised(this.c.parameters(), kind, iu, x);
    if (!at) return null;
    const all = [...this.reals(at, 26)];
    return { A: all.slice(0, 16), B: all.slice(16, 20), K: all.slice(20, 24), k_i: all[24], k_s: all[25] };
  }

  /** exp(A time) of a matrix of order 5. */
  transition(A: number[][], time: number): number[][] {
    this.reals(this.c.rates(), 25).set(A.flat());
    this.c.transition(time);
    const all = [...this.reals(this.c.rates(), 25)];
    return A.map((_, i) => all.slice(5 * i, 5 * i + 5));
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
