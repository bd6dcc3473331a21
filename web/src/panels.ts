// The charts of a run, each in a card of its own.

import { aroundZero, Chart, colour, type Axes, type Band, type Line } from "./charts";
import { KINDS, type Core, type Flight, type History } from "./core";
import { StiffnessMap } from "./map";
import { Later, sensitivity, zone, ZONES, type Sensitivity } from "./margins";
import { spectrum } from "./spectrum";
import type { Settings } from "./state";
import { digits, shown } from "./units";

export interface Card {
  element: HTMLElement;
  body: HTMLElement;
  say: HTMLElement;
  head: HTMLElement;
}

export function card(parent: HTMLElement, id: string, title: string, size = ""): Card {
  const element = document.createElement("section");
  element.id = id;
  element.className = `card ${size}`;
  element.innerHTML = '<div class="head"><h2></h2><span class="say"></span></div><div class="chart" role="img"></div>';
  element.querySelector("h2")!.textContent = title;
  element.querySelector(".chart")!.setAttribute("aria-label", title);
  parent.append(element);
  const part = (name: string) => element.querySelector<HTMLElement>(name)!;
  return { element, body: part(".chart"), say: part(".say"), head: part(".head") };
}

/** For those who hear the page: a chart is its title and what is said of it. */
export function describe(of: Card): void {
  of.body.setAttribute("aria-label", `${of.head.querySelector("h2")!.textContent ?? ""}: ${of.say.textContent ?? ""}`);
}

export const NIS_FROM = 50; // figures exclude the first of this many parts
const NIS_LIMITS = [0.7, 1.4], NIS_FAIR = [0.5, 2.2];

/** Errors of a filter against the truth, from a fiftieth of the flight on, and how consistent it is. */
export interface Figures {
  x: number;
  v: number;
  f_d: number;
  nis: number;
}

export function figures(flight: Flight, of: History): Figures {
  const from = Math.floor(flight.n / NIS_FROM), sums = [0, 0, 0, 0];
  let taken = 0;
  for (let k = from; k < flight.n; k++) {
    const at = of.states * k;
    sums[0] += (of.mean[at] - flight.x[k]) ** 2;
    sums[1] += (of.mean[at + 1] - flight.v[k]) ** 2;
    sums[2] += (of.mean[at + 2] - flight.load[k]) ** 2;
    if (of.variance[k] > 0) {
      sums[3] += of.innovation[k] ** 2 / of.variance[k];
      taken++;
    }
  }
  const n = flight.n - from, [x, v, f_d] = sums.slice(0, 3).map((sum) => Math.sqrt(sum / n));
  return { x, v, f_d, nis: taken ? sums[3] / taken : NaN };
}

export function lamp(nis: number): { tone: string; text: string } {
  if (!Number.isFinite(nis)) return { tone: "", text: "states no variance" };
  const within = ([low, high]: number[]) => nis > low && nis < high;
  if (within(NIS_LIMITS)) return { tone: "good", text: "consistent" };
  const text = nis > 1 ? "overconfident" : "too cautious";
  return { tone: within(NIS_FAIR) ? "fair" : "bad", text };
}

function column(of: History, j: number, n: number): Float64Array {
  const to = new Float64Array(n);
  for (let k = 0; k < n; k++) to[k] = of.mean[of.states * k + j];
  return to;
}

/** mean + share * standard deviation of state j. */
function edge(of: History, j: number, n: number, share: number): Float64Array {
  const to = new Float64Array(n), { states } = of, pairs = (states * (states + 1)) / 2, at = j * states - (j * (j - 1)) / 2;
  for (let k = 0; k < n; k++) to[k] = of.mean[states * k + j] + share * Math.sqrt(Math.max(0, of.cov[pairs * k + at]));
  return to;
}

export class Panels {
  readonly cards: Record<string, Card> = {};
  private readonly plots: Record<string, Chart> = {};
  readonly map: StiffnessMap;
  margin: Sensitivity | null = null; // with the filter in the loop
  readonly later = new Later();

  constructor(parent: HTMLElement) {
    const make = (id: string, title: string, size = "", sync: string | null = "time") => {
      this.cards[id] = card(parent, id, title, size);
      this.plots[id] = new Chart(this.cards[id].body, sync);
    };
    make("response", "Position");
    make("force", "Disturbance force, ±2σ");
    make("error", "Error of the position");
    make("innovation", "Innovations, ±2√S");
    this.cards.map = card(parent, "map", "Stiffness", "third");
    make("sensitivity", "Sensitivity", "third", null);
    make("spectrum", "Spectrum", "third", null);
    const canvas = document.createElement("canvas");
    canvas.className = "map";
    this.cards.map.body.append(canvas);
    this.map = new StiffnessMap(canvas);
    const choose = document.createElement("button");
    choose.type = "button";
    choose.textContent = "k_i";
    choose.setAttribute("aria-label", "Show k_i or k_s");
    this.cards.map.head.insertBefore(choose, this.cards.map.say);
    choose.addEventListener("click", () => {
      this.map.which = this.map.which === "k_i" ? "k_s" : "k_i";
      choose.textContent = this.map.which;
      parent.dispatchEvent(new Event("redraw"));
    });
  }

  get charts(): [string, Chart][] {
    return Object.entries(this.plots);
  }

  /** All charts of a flight. */
  show(core: Core, s: Settings, parameters: Record<string, number>, flight: Flight): void {
    const { n, T, filters } = flight, t = Float64Array.from({ length: n }, (_, k) => k * T);
    this.overTime(t, flight);
    const first = filters[0], f = figures(flight, first), judged = lamp(f.nis);
    this.cards.innovation.say.innerHTML = `<i class="lamp ${judged.tone}"></i>NIS ${digits(f.nis)}, ${judged.text}`;
    this.others(core, s, parameters, flight, n);
    const bounds = [1, -1].map((side) => first.variance.map((S) => side * 2 * Math.sqrt(S)));
    this.plots.innovation.show(t, [first.innovation, ...bounds],
      [{ label: "innovation", colour: "f0", width: 1 }, { label: "+2√S", colour: "accent", width: 1 }, { label: "−2√S", colour: "accent", width: 1 }],
      [], { unit: "e [µm]", scale: 1e6 });
  }

  private overTime(t: Float64Array, flight: Flight): void {
    const { n, filters } = flight;
    // The first filter is drawn last, above the others.
    const lines = filters.map((of, j): Line => ({ label: KINDS[of.kind].short, colour: `f${j}`, width: 1.3 })).reverse();
    const estimates = (j: number) => filters.map((of) => column(of, j, n)).reverse();
    const step = (axes: Partial<Axes> = {}): Axes => ({ unit: "x [mm]", scale: 1e3, ...axes });
    this.plots.response.show(t, [flight.y, flight.r, ...estimates(0), flight.x],
      [{ label: "reading", colour: "sensor", width: 1, faint: true }, { label: "reference", colour: "accent", dash: [6, 4], width: 1.3 },
        ...lines, { label: "truth", colour: "truth", width: 1.8 }], [], step());
    const last = flight.x[n - 1], over = overshoot(flight);
    const touched = flight.atStop.some((at) => at > 0);
    this.cards.response.say.textContent = touched ? "touches a stop" : `overshoot ${Number.isFinite(over) ? digits(100 * over, 2) : "–"} %, ends at ${shown(last, "m")}`;
    const first = filters[0], bands: Band[] = [{ upper: 1, lower: 2, colour: "f0" }];
    this.plots.force.show(t, [edge(first, 2, n, 2), edge(first, 2, n, -2), ...estimates(2), flight.load],
      [{ label: "+2σ", colour: "f0", width: 0.5, faint: true }, { label: "−2σ", colour: "f0", width: 0.5, faint: true }, ...lines,
        { label: "truth", colour: "truth", width: 1.8, dash: [5, 3] }],
      bands, { unit: "f_d [N]", scale: 1, range: robust(flight) });
    const errors = estimates(0).map((of) => of.map((value, k) => value - flight.x[k]));
    this.plots.error.show(t, [flight.y.map((value, k) => value - flight.x[k]), ...errors],
      [{ label: "reading", colour: "sensor", width: 1, faint: true }, ...lines], [], { unit: "error [µm]", scale: 1e6, range: aroundZero });
    const raw = Math.sqrt(flight.y.reduce((sum, value, k) => sum + (value - flight.x[k]) ** 2, 0) / n);
    this.cards.error.say.textContent = `raw sensor ${shown(raw, "m")} RMS`;
    this.cards.force.say.textContent = `truth steps to ${shown(flight.load[n - 1], "N")}`;
  }

  private others(core: Core, s: Settings, parameters: Record<string, number>, flight: Flight, n: number): void {
    this.margins(core, s, parameters);
    const of_x = spectrum(flight.x, flight.T), of_y = spectrum(flight.y, flight.T);
    this.plots.spectrum.show(of_x.f, [of_y.amplitude, of_x.amplitude],
      [{ label: "reading", colour: "sensor", width: 1 }, { label: "truth", colour: "truth", width: 1.5 }], [],
      { unit: "amplitude [µm]", scale: 1e6, x: { label: "f [Hz]", log: true }, yLog: true, decades: true });
    for (const card of Object.values(this.cards)) describe(card);
    this.map.show(core, s, flight);
    this.map.point(flight.iu[n - 1], flight.x[n - 1]);
    const k = core.magnet(flight.iu[n - 1], flight.x[n - 1]);
    this.cards.map.say.textContent = `k_i ${digits(k.k_i)} N/A, k_s ${digits(k.k_s * 1e-3)} N/mm`;
  }

  /** The sensitivity of the loop; fed by a filter, with each of them in its place. */
  private margins(core: Core, s: Settings, parameters: Record<string, number>): void {
    const reference = Math.min(Math.max(s.reference, -s.p.clearance), s.p.clearance), p = { ...parameters, reference, load: 0, start: 0 };
    const kinds = s.p.feedback > 0 ? s.kinds : s.kinds.slice(0, 1), all: [string, Sensitivity | null][] = [];
    const work = kinds.map((kind) => () => all.push([s.p.feedback > 0 ? KINDS[kind].short : "fed by the sensor", sensitivity(core, p, kind)]));
    this.later.start([...work, () => {
      this.margin = all[0][1];
      showSensitivity(this.plots.sensitivity, this.cards.sensitivity, all);
    }]);
  }
}

/** |S| of loops with their zones, the first of them as it flies. */
export function showSensitivity(plot: Chart, card: Card, all: [string, Sensitivity | null][]): void {
  const first = all[0][1], drawn = all.flatMap(([name, of], j) => (of ? [{ name, of, j }] : [])).reverse();
  if (!first) return void (card.say.textContent = "no filter can be made of these settings");
  plot.show(first.f, drawn.map(({ of }) => (of === first ? of.S : resampled(of, first.f))), drawn.map(({ name, j }): Line => ({ label: name, colour: all.length > 1 ? `f${j % 4}` : "truth", width: j ? 1.3 : 1.8 })), [], {
    unit: "|S|", scale: 1, x: { label: "f [Hz]", log: true }, yLog: true, draw: (u) => zones(u, first),
  });
  const worse = all.flatMap(([name, of]) => (of && of !== first && zone(of) !== zone(first) ? [`${name} ${of.stable ? digits(of.peak, 3) : "unstable"}`] : []));
  const own = first.stable ? `peak ${digits(first.peak)} at ${shown(first.at, "Hz")}, zone ${zone(first)}` : "unstable";
  card.say.textContent = [own, ...worse].join("; ");
  describe(card);
}

/** |S| of a loop at the frequencies of another, by lines between its own. */
function resampled(of: Sensitivity, f: number[]): number[] {
  let k = 0;
  return f.map((at) => {
    while (k < of.f.length - 2 && of.f[k + 1] < at) k++;
    const share = Math.min(Math.max((at - of.f[k]) / (of.f[k + 1] - of.f[k]), 0), 1);
    return of.S[k] + share * (of.S[k + 1] - of.S[k]);
  });
}

/** Of the reference step, by what of its height the rotor goes beyond it. */
export function overshoot(flight: Flight): number {
  const from = Math.round(flight.n / 10), to = Math.round(flight.n / 2), step = flight.r[from];
  if (!step) return NaN;
  let most = 0;
  for (let k = from; k < to; k++) most = Math.max(most, flight.x[k] / step - 1);
  return most;
}

/** A range of forces about the truth in which the start of a filter does not decide. */
function robust(flight: Flight): (low: number, high: number) => [number, number] {
  const values: number[] = [], from = Math.floor(flight.n / 12);
  for (const of of flight.filters) for (let k = from; k < flight.n; k += 7) values.push(of.mean[of.states * k + 2]);
  values.sort((a, b) => a - b);
  const low = Math.min(values[Math.floor(values.length * 0.01)], ...[0, flight.load[flight.n - 1]]);
  const high = Math.max(values[Math.floor(values.length * 0.99)], ...[0, flight.load[flight.n - 1]]);
  const room = 0.25 * (high - low) || 1;
  return () => [low - room, high + room];
}

/** The zones of ISO 14839-3 behind a sensitivity, and its peak. */
function zones(u: { ctx: CanvasRenderingContext2D; bbox: { left: number; top: number; width: number; height: number }; valToPos(v: number, scale: string, canvas: boolean): number }, of: Sensitivity): void {
  const { ctx, bbox } = u, by = window.devicePixelRatio || 1;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.font = `${11 * by}px system-ui, sans-serif`;
  for (const [k, [name, end]] of ZONES.entries()) {
    const y = u.valToPos(end, "y", true);
    ctx.strokeStyle = ctx.fillStyle = colour(["good", "fair", "bad"][k]);
    ctx.setLineDash([5 * by, 4 * by]);
    ctx.lineWidth = by;
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(bbox.left + bbox.width, y);
    ctx.stroke();
    ctx.fillText(name, bbox.left + (6 + 14 * k) * by, y - 3 * by);
  }
  if (of.stable) {
    ctx.setLineDash([]);
    ctx.fillStyle = colour("accent");
    ctx.beginPath();
    ctx.arc(u.valToPos(of.at, "x", true), u.valToPos(of.peak, "y", true), 4 * by, 0, 2 * Math.PI);
    ctx.fill();
  }
  ctx.restore();
}
