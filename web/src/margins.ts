// The sensitivity of the loop at the operating point: sampled plant, lag, dead time, digital PID, and the
// linear Kalman filter with its settled gain where that feeds the controller.

import type { Core, Parameters } from "./core";

type Complex = [number, number];
const add = (a: Complex, b: Complex): Complex => [a[0] + b[0], a[1] + b[1]];
const sub = (a: Complex, b: Complex): Complex => [a[0] - b[0], a[1] - b[1]];
const mul = (a: Complex, b: Complex): Complex => [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]];
const div = (a: Complex, b: Complex): Complex => {
  const d = b[0] * b[0] + b[1] * b[1];
  return [(a[0] * b[0] + a[1] * b[1]) / d, (a[1] * b[0] - a[0] * b[1]) / d];
};
const times = (a: Complex, by: number): Complex => [a[0] * by, a[1] * by];
const abs = (a: Complex) => Math.hypot(a[0], a[1]);

type Matrix = number[][];
const product = (a: Matrix, b: Matrix): Matrix =>
  a.map((row) => b[0].map((_, j) => row.reduce((sum, value, k) => sum + value * b[k][j], 0)));

/** Solve (z I - A) x = b for a small system. */
export function resolve(A: Matrix, z: Complex, b: Complex[]): Complex[] {
  const n = A.length;
  const M: Complex[][] = A.map((row, i) => [...row.map((value, j): Complex => [(i === j ? z[0] : 0) - value, i === j ? z[1] : 0]), b[i]]);
  for (let k = 0; k < n; k++) {
    let pivot = k;
    for (let i = k + 1; i < n; i++) if (abs(M[i][k]) > abs(M[pivot][k])) pivot = i;
    [M[k], M[pivot]] = [M[pivot], M[k]];
    for (let i = 0; i < n; i++) {
      if (i === k) continue;
      const by = div(M[i][k], M[k][k]);
      for (let j = k; j <= n; j++) M[i][j] = sub(M[i][j], mul(by, M[k][j]));
    }
  }
  return M.map((row, i) => div(row[n], row[i]));
}

export interface Sensitivity {
  f: number[]; // [Hz]
  S: number[]; // |S|
  peak: number;
  at: number; // [Hz]
  stable: boolean;
}

/** Zones of ISO 14839-3 and the peaks of |S| at which they end. */
export const ZONES: [string, number][] = [["A", 3], ["B", 4], ["C", 5]];

export function zone(of: Sensitivity): string {
  if (!of.stable) return "unstable";
  return ZONES.find(([, end]) => of.peak < end)?.[0] ?? "D";
}

/** The plant from the demanded current to position, velocity and reading, with what waits in the line. */
function sampled(core: Core, p: Parameters, k_i: number, k_s: number): { A: Matrix; b: number[] } {
  const lag = Math.max(p.lag, 1e-3 * p.T), lags = p.bandwidth > 0;
  const corner = Math.min(lags ? 2 * Math.PI * p.bandwidth : Infinity, 1e3 / p.T), drive = k_i / p.mass;
  // x, v, x_m, i, demanded: held
  const rates: Matrix = [
    [0, 1, 0, 0, 0], [k_s / p.mass, 0, 0, lags ? drive : 0, lags ? 0 : drive], [p.K_sen / lag, 0, -1 / lag, 0, 0],
    [0, 0, 0, -corner, lags ? corner : 0], [0, 0, 0, 0, 0],
  ];
  const samples = p.delay / p.T, whole = Math.floor(samples + 1e-9), rest = Math.max(0, samples - whole);
  const before = core.transition(rates, rest * p.T), after = core.transition(rates, (1 - rest) * p.T);
  const held = 4 + whole + 1; // four states, then demands of the samples before
  const A: Matrix = Array.from({ length: held }, () => Array(held).fill(0));
  const b: number[] = Array(held).fill(0);
  const both = product(after, before);
  for (let i = 0; i < 4; i++) {
    for (let j = 0; j < 4; j++) A[i][j] = both[i][j];
    let early = 0;
    for (let k = 0; k < 4; k++) early += after[i][k] * before[k][4];
    A[i][4 + whole] += early; // the oldest demand acts at first ...
    if (whole === 0) b[i] += after[i][4];
    else A[i][4 + whole - 1] += after[i][4]; // ... then the next
  }
  b[4] = 1;
  for (let k = 1; k <= whole; k++) A[4 + k][4 + k - 1] = 1;
  return { A, b };
}

export function sensitivity(core: Core, p: Parameters, kind: number, x: number, load: number, points = 240): Sensitivity | null {
  core.state(p);
  const iu = core.levitation(x, load), filter = core.linearised(kind, iu, x);
  if (!filter) return null;
  const plant = sampled(core, p, filter.k_i, filter.k_s);
  const own = Math.sqrt(Math.abs(filter.k_s) / p.mass) / (2 * Math.PI);
  const low = Math.min(own / 20, 0.1 / p.T), high = 0.5 / p.T;
  const f = Array.from({ length: points }, (_, k) => low * (high / low) ** (k / (points - 1)));
  const fed = p.feedback > 0, A4: Matrix = [0, 1, 2, 3].map((i) => filter.A.slice(4 * i, 4 * i + 4));
  // Errors of the estimate: X = (I - K c) (A X' + B u') + K y, with c = (0, 0, 0, 1).
  const left: Matrix = [0, 1, 2, 3].map((i) => [0, 1, 2, 3].map((j) => (i === j ? 1 : 0) - (j === 3 ? filter.K[i] : 0)));
  const closed = product(left, A4), byU = product(left, filter.B.map((value) => [value])).map((row) => row[0]);
  const S = f.map((at) => {
    const w = 2 * Math.PI * at * p.T, z: Complex = [Math.cos(w), Math.sin(w)], back: Complex = [z[0], -z[1]];
    const P = resolve(plant.A, z, plant.b.map((value): Complex => [value, 0]))[2];
    const integral = div([p.ki * p.T, 0], sub(z, [1, 0]));
    const share = 1 / (p.T_f + p.T);
    let C: Complex;
    if (fed) {
      const y = resolve(closed, z, filter.K.map((value) => mul([value, 0], z)));
      const u = resolve(closed, z, byU.map((value): Complex => [value, 0]));
      const take = (e: Complex[]) => add(mul(add([p.kp, 0], integral), e[0]), times(e[1], p.kd));
      C = div(take(y), add([1, 0], times(take(u), 1 / p.gain))); // iu = -(Cy y + Cu iu/gain)
    } else {
      const slope = div(times(sub([1, 0], back), share), sub([1, 0], times(back, 1 - p.T * share)));
      C = times(add(add([p.kp, 0], integral), times(slope, p.kd)), 1 / p.K_sen);
    }
    return div([1, 0], add([1, 0], mul(P, C)));
  });
  const size = S.map(abs), peak = Math.max(...size);
  const stable = radius(closedLoop(p, plant, closed, byU, filter.K)) < 1;
  return { f, S: size, peak: stable ? peak : Infinity, at: f[size.indexOf(peak)], stable };
}

/** The closed loop's transition, column by column: plant, estimate, integral, velocity, last position. */
function closedLoop(p: Parameters, plant: { A: Matrix; b: number[] }, closed: Matrix, byU: number[], K: number[]): Matrix {
  const n = plant.b.length, all = n + 7;
  const next = (X: number[]): number[] => {
    const dot = (row: number[], from: number[]) => row.reduce((sum, value, k) => sum + value * from[k], 0);
    const held = X.slice(0, n), mean = X.slice(n, n + 4), y = held[2];
    const now = closed.map((row, i) => dot(row, mean) + (byU[i] / p.gain) * held[4] + K[i] * y);
    const [integral, slope, last] = X.slice(n + 4);
    const x = p.feedback > 0 ? now[0] : y / p.K_sen;
    const v = p.feedback > 0 ? now[1] : slope + (x - last - p.T * slope) / (p.T_f + p.T);
    const iu = -p.kp * x + integral - p.kd * v;
    const on = plant.A.map((row, i) => dot(row, held) + plant.b[i] * iu);
    return [...on, ...now, integral - p.T * p.ki * x, v, x];
  };
  const columns = Array.from({ length: all }, (_, j) => next(Array.from({ length: all }, (_, i) => (i === j ? 1 : 0))));
  return columns[0].map((_, i) => columns.map((column) => column[i]));
}

/** The spectral radius, from powers of a matrix. */
function radius(A: Matrix): number {
  let power = balanced(A), log = 0;
  for (let k = 0; k < 22; k++) {
    power = product(power, power);
    const size = Math.max(...power.map((row) => Math.max(...row.map(Math.abs))));
    if (!(size > 0)) return 0;
    power = power.map((row) => row.map((value) => value / size));
    log = 2 * log + Math.log(size);
  }
  return Math.exp(log / 2 ** 22);
}

/** The same matrix in other units of its states, such that rows and columns are alike in size (Parlett, Reinsch 1969). */
function balanced(A: Matrix): Matrix {
  const B = A.map((row) => [...row]), n = B.length;
  for (let round = 0; round < 12; round++)
    for (let i = 0; i < n; i++) {
      let row = 0, column = 0;
      for (let j = 0; j < n; j++)
        if (j !== i) {
          row += Math.abs(B[i][j]);
          column += Math.abs(B[j][i]);
        }
      if (!row || !column) continue;
      const by = 2 ** Math.round(0.5 * Math.log2(row / column));
      for (let j = 0; j < n; j++) {
        B[i][j] /= by;
        B[j][i] *= by;
      }
    }
  return B;
}
