// The workbench of a rotor: its drawing, controls and charts.

import { aroundZero, Chart, colour, type Line } from "./charts";
import type { Card } from "./panels";
import { card, describe, lamp, NIS_FROM, showSensitivity, type Figures } from "./panels";
import { slider } from "./knobs";
import { orbits } from "./orbit";
import { FilterTable } from "./filters";
import { KINDS } from "./core";
import { Later, type Sensitivity } from "./margins";
import { along, estimated, type Rotor, type RotorCore, type RotorFlight, type RotorHistory, type RotorLive } from "./rotor_core";
import { assumed, described, freshRotor, kindsOf, ROTOR_KINDS, ROTOR_KNOBS, type RotorSettings } from "./rotor_knobs";
import { across, alongAxes, axesOf, radials, RotorPicture } from "./rotor_picture";
import { spectrum } from "./spectrum";
import { digits, shown } from "./units";

const KNOCK = 0.0015; // seconds

export class RotorBench {
  settings!: RotorSettings;
  own!: RotorSettings;
  flight: RotorFlight | null = null;
  now: RotorLive | null = null;
  active = false;
  slow = 30;
  running = true;
  off = false;
  took = 0;
  private machine!: Rotor;
  private drawn!: Rotor;
  private readonly cards: Record<string, Card> = {};
  private readonly plots: Record<string, Chart> = {};
  private readonly canvas = document.createElement("canvas");
  private readonly rows: { show(): void }[] = [];
  private readonly table: FilterTable;
  readonly later = new Later();
  // of each axis, or for each filter that could feed the controllers
  margins: [string, Sensitivity | null][] = [];
  private readonly picture: RotorPicture;
  private last = 0;
  private due = 0;
  private late = false;
  private grabbed: { bearing: number; up: number; right: number } | null = null;
  private knock = { push: [] as number[], samples: 0 };

  constructor(private readonly core: RotorCore, private readonly live: RotorCore, private readonly svg: SVGSVGElement,
              private readonly panel: HTMLElement, charts: HTMLElement, private readonly changed: () => void,
              private readonly said: (text: string) => void, private readonly read: (live: RotorLive) => void) {
    const make = (id: string, title: string, size = "", sync: string | null = "rotor") => {
      this.cards[id] = card(charts, id, title, size);
      this.cards[id].element.dataset.for = "rotor";
      this.plots[id] = new Chart(this.cards[id].body, sync);
    };
    const filters = document.createElement("div");
    filters.className = "card wide filters";
    filters.dataset.for = "rotor";
    charts.append(filters);
    this.table = new FilterTable(filters, {
      kinds: () => kindsOf(this.settings), known: () => ROTOR_KINDS,
      set: (kinds) => {
        this.settings.filters = kinds.map((kind) => KINDS[kind].name).join(",");
        this.change(false);
      },
    });
    this.cards.orbits = card(charts, "orbits", "Orbits, last fifth of the run");
    this.cards.orbits.element.dataset.for = "rotor";
    this.canvas.className = "map";
    this.cards.orbits.body.append(this.canvas);
    make("displacements", "Displacements along the axes");
    make("radius", "Orbit over time, or over speed");
    make("rotor-force", "Disturbance force of the first axis, ±2σ");
    make("rotor-error", "Error of the first displacement");
    make("rotor-innovation", "Innovations of the first sensor, ±2√S");
    make("currents", "Control currents");
    make("rotor-sensitivity", "Sensitivity", "", null);
    make("lines", "Spectrum of the first axis", "wide", null);
    this.picture = new RotorPicture(svg);
    this.pointer();
    requestAnimationFrame((t) => this.frame(t));
  }

  choose(machine: Rotor, settings: Partial<RotorSettings> = {}): void {
    this.machine = machine;
    this.own = freshRotor(machine);
    this.settings = { ...this.own, ...settings };
    this.off = false;
    this.build();
    this.change(true);
  }

  private build(): void {
    this.panel.replaceChildren();
    this.rows.length = 0;
    let box: HTMLDetailsElement | null = null;
    for (const knob of ROTOR_KNOBS(this.machine)) {
      if (box?.dataset.group !== knob.group) {
        box = document.createElement("details");
        box.dataset.group = knob.group;
        box.open = knob.group === "Rotation" || innerWidth > 820;
        const head = document.createElement("summary");
        head.textContent = knob.group;
        box.append(head);
        this.panel.append(box);
        if (knob.group === "Rotation") box.append(this.choice("run-up", "Over the flight", [["0", "at this speed"], ["1", "from rest up to it"]],
          () => (this.settings.runUp ? 1 : 0), (value) => (this.settings.runUp = value > 0)));
        if (knob.group === "Controllers") box.append(this.choice("fed", "Fed by", [["0", "sensors"], ["1", "first filter"]],
          () => this.settings.feedback, (value) => (this.settings.feedback = value)));
        if (knob.group === "Flight") box.append(this.choice("noise", "Noise", [["1", "on"], ["0", "off"]],
          () => (this.settings.noisy ? 1 : 0), (value) => (this.settings.noisy = value > 0)));
      }
      const row = slider(knob, this.own, () => this.settings, () => this.change(false));
      box.append(row.row);
      this.rows.push(row);
    }
  }

  private choice(id: string, text: string, options: string[][], now: () => number, set: (value: number) => void): HTMLElement {
    const row = document.createElement("div"), label = document.createElement("label"), select = document.createElement("select");
    row.className = "choice";
    select.id = `choice-${id}`;
    label.htmlFor = select.id;
    label.textContent = text;
    select.append(...options.map(([value, name]) => new Option(name, value)));
    select.addEventListener("change", () => {
      set(Number(select.value));
      this.change(false);
    });
    row.append(label, select);
    this.rows.push({ show: () => (select.value = String(now())) });
    return row;
  }

  /** Settings have changed; `anew`: the rotor under the hand begins in the middle. */
  change(anew: boolean): void {
    this.drawn = described(this.machine, this.settings);
    this.take(this.live);
    this.live.start(kindsOf(this.settings)[0], anew);
    if (anew) this.picture.build(this.drawn);
    this.rows.forEach((row) => row.show());
    this.changed();
    if (this.late) return;
    this.late = true;
    requestAnimationFrame(() => {
      this.late = false;
      if (this.active) this.compute();
    });
  }

  private take(core: RotorCore): void {
    const { settings } = this;
    core.take(this.drawn, settings.feedback > 0, assumed(this.machine, settings), settings.seed, settings.noisy);
  }

  /** Loads and speeds of the flight. */
  signals(): { load: Float64Array; speed: Float64Array } {
    const { axes, T } = this.machine, n = Math.min(10001, Math.round(0.5 / T) + 1);
    const load = new Float64Array(n * axes), speed = new Float64Array(n + 1);
    for (let k = Math.round(n / 2); k < n; k++) load[k * axes] = this.settings.push;
    for (let k = 0; k <= n; k++) speed[k] = this.settings.runUp ? (this.settings.speed * k) / n : this.settings.speed;
    return { load, speed };
  }

  compute(): void {
    const from = performance.now(), { load, speed } = this.signals();
    this.take(this.core);
    this.flight = this.core.fly(load, speed, kindsOf(this.settings));
    const flown = performance.now() - from;
    if (!this.flight) return this.said("These settings are not possible: no filter can be made of them.");
    this.show(this.flight, load);
    this.sensitivities();
    this.took = performance.now() - from;
    this.said(`${this.machine.axes} axes and ${this.flight.filters.length} filters over ${this.flight.n.toLocaleString("en")} samples in ${flown.toFixed(0)} ms, with all charts in ${this.took.toFixed(0)} ms`);
  }

  private show(flight: RotorFlight, load: Float64Array): void {
    const of = this.drawn, { n, T } = flight, t = Float64Array.from({ length: n }, (_, k) => k * T);
    const s = of.names.map((_, f) => along(of, flight, f)), lines = of.names.map((name, f): Line => ({ label: name, colour: `f${f % 4}`, width: 1.2 }));
    this.plots.displacements.show(t, s, lines, [], { unit: "s [µm]", scale: 1e6, range: aroundZero });
    const touched = flight.atStop.some((at) => at > 0);
    this.cards.displacements.say.innerHTML = of.names.map((_, f) => `<i class="lamp" style="background:var(--f${f % 4})"></i><span></span>`).join(" ");
    this.cards.displacements.say.querySelectorAll("span").forEach((span, f) => (span.textContent = of.names[f]));
    const paths = radials(of).slice(0, 2).map((k) => {
      const bearing = of.bearings[k], a = bearing.angle, [at] = axesOf(of, k), first = s[at], second = s[at + 1];
      return {
        name: `bearing ${bearing.name}`, travel: of.filter.view.clearance[at],
        up: first.map((value, i) => Math.cos(a) * value - Math.sin(a) * second[i]),
        right: first.map((value, i) => Math.sin(a) * value + Math.cos(a) * second[i]),
      };
    });
    orbits(this.canvas, paths, Math.floor(0.8 * n));
    this.cards.orbits.say.innerHTML = '<i class="lamp"></i><span></span>';
    this.cards.orbits.say.querySelector("i")!.classList.add(touched ? "bad" : "good");
    this.cards.orbits.say.querySelector("span")!.textContent = touched ? "touches a stop" : "free of its stops";
    const radius = paths.map((path) => path.up.map((up, k) => Math.hypot(up, path.right[k])));
    const rpm = flight.speed.slice(0, n).map((value) => (value * 30) / Math.PI), over = this.settings.runUp && this.settings.speed > 0;
    this.plots.radius.show(over ? rpm : t, radius, paths.map((path, k): Line => ({ label: path.name, colour: `f${k}`, width: 1.2 })), [],
      { unit: "from the middle [µm]", scale: 1e6, x: over ? { label: "speed [rpm]" } : undefined });
    const most = radius.map((one) => one.reduce((a, b) => Math.max(a, b), 0)), share = Math.max(...most.map((far, k) => far / paths[k].travel));
    this.cards.radius.say.textContent = `at most ${shown(Math.max(...most), "m")}, ${digits(100 * share, 2)} % of the clearance`;
    const currents = of.names.map((_, f) => Float64Array.from({ length: n }, (_, k) => flight.iu[k * of.axes + f]));
    this.plots.currents.show(t, currents, lines, [], { unit: "i_u [A]", scale: 1 });
    this.cards.currents.say.textContent = `limit ±${shown(of.iu_max[0], "A")}`;
    this.filtered(flight, t, s[0], load);
    this.lines(s[0], T);
    Object.values(this.cards).forEach(describe);
  }

  /** What filters make of the readings, against the truth. */
  private filtered(flight: RotorFlight, t: Float64Array, s: Float64Array, load: Float64Array): void {
    const of = this.drawn, { filters, n } = flight;
    for (const id of ["rotor-force", "rotor-error", "rotor-innovation"]) this.cards[id].element.hidden = !filters.length;
    if (!filters.length) return;
    const lines = filters.map((one, j): Line => ({ label: KINDS[one.kind].short, colour: `f${j}`, width: 1.3 })).reverse();
    const unit = (j: number) => Array.from({ length: filters[0].states }, (_, i) => (i === j ? 1 : 0)), force = unit(of.filter.loads);
    const truth = Float64Array.from({ length: n }, (_, k) => load[k * of.axes]), forces = filters.map((one) => estimated(force, one, n)).reverse();
    const band = this.band(filters[0], forces[forces.length - 1]);
    this.plots["rotor-force"].show(t, [...band, ...forces, truth],
      [...band.map((): Line => ({ label: "2σ", colour: "f0", width: 0.5, faint: true })), ...lines, { label: "truth", colour: "truth", width: 1.8, dash: [5, 3] }],
      band.length ? [{ upper: 1, lower: 2, colour: "f0" }] : [], { unit: "f_d [N]", scale: 1, range: settled([...forces, truth]) });
    const hats = filters.map((one) => estimated(of.filter.along[0], one, n).map((value, k) => value - s[k])).reverse();
    const reading = s.map((value, k) => flight.y[k * of.sensors] / of.gain[0] - value);
    // a sensor at another place measures another displacement
    const beside = of.sensors === of.axes && rms(reading) < 5 * Math.sqrt(of.var_y[0]);
    this.plots["rotor-error"].show(t, beside ? [reading, ...hats] : hats, [...(beside ? [{ label: "reading", colour: "sensor", width: 1, faint: true }] : []), ...lines], [],
      { unit: "error [µm]", scale: 1e6, range: settled([...(beside ? [reading] : []), ...hats], 1e6) });
    this.cards["rotor-error"].say.textContent = beside ? `raw sensor ${shown(rms(reading), "m")} RMS` : "";
    const all = filters.map((one) => this.figures(flight, one, load)), judged = lamp(all[0].nis);
    this.table.show(all);
    this.cards["rotor-innovation"].say.innerHTML = `<i class="lamp ${judged.tone}"></i>NIS ${digits(all[0].nis)}, ${judged.text}`;
    this.cards["rotor-force"].say.textContent = `truth steps to ${shown(truth[n - 1], "N")}`;
    const first = (series: Float64Array) => Float64Array.from({ length: n }, (_, k) => series[k * of.sensors]), S = first(filters[0].variance);
    this.plots["rotor-innovation"].show(t, [first(filters[0].innovation), ...[1, -1].map((side) => S.map((one) => side * 2 * Math.sqrt(one)))],
      [{ label: "innovation", colour: "f0", width: 1 }, { label: "+2√S", colour: "accent", width: 1 }, { label: "−2√S", colour: "accent", width: 1 }],
      [], { unit: "e [µm]", scale: 1e6 });
  }

  /** Two standard deviations about the first disturbance force. */
  private band(of: RotorHistory, force: Float64Array): Float64Array[] {
    const { cov, states } = of, j = this.drawn.filter.loads, pairs = (states * (states + 1)) / 2, at = j * states - (j * (j - 1)) / 2;
    if (!cov) return [];
    return [1, -1].map((side) => force.map((value, k) => value + side * 2 * Math.sqrt(Math.max(0, cov[k * pairs + at]))));
  }

  /** Root mean squares over all axes, and NIS over all sensors. */
  private figures(flight: RotorFlight, one: RotorHistory, load: Float64Array): Figures {
    const of = this.drawn, { n } = flight, square = (error: Float64Array) => rms(error) ** 2, sums = { x: 0, v: 0, f_d: 0 };
    for (let f = 0; f < of.axes; f++) {
      const s = along(of, flight, f), v = along(of, flight, f, true);
      sums.x += square(estimated(of.filter.along[f], one, n).map((value, k) => value - s[k]));
      sums.v += square(estimated(of.filter.moving[f], one, n).map((value, k) => value - v[k]));
      sums.f_d += square(Float64Array.from({ length: n }, (_, k) => one.mean[k * one.states + of.filter.loads + f] - load[k * of.axes + f]));
    }
    let sum = 0, taken = 0;
    for (let k = Math.floor(n / NIS_FROM) * of.sensors; k < n * of.sensors; k++) {
      if (!(one.variance[k] > 0)) continue;
      sum += one.innovation[k] ** 2 / one.variance[k];
      taken++;
    }
    const mean = (of_all: number) => Math.sqrt(of_all / of.axes);
    return { x: mean(sums.x), v: mean(sums.v), f_d: mean(sums.f_d), nis: taken ? sum / taken : NaN };
  }

  /** |S| of each axis; fed by a filter, of the worst axis with each filter in the loop. */
  private sensitivities(): void {
    const of = this.drawn, { speed, feedback } = this.settings, kinds = kindsOf(this.settings), all: [string, Sensitivity | null][] = [];
    const axes = of.names.map((_, f) => f), one = (kind: number, f: number) => this.core.sensitivity(f, kind, speed);
    const loops = feedback > 0 ? kinds : axes.map(() => kinds[0]);
    const work = loops.flatMap((kind, j) => (feedback > 0 ? axes : [j]).map((f, k) => () => {
      const found = one(kind, f);
      if (k === 0) all.push([feedback > 0 ? KINDS[kind].short : of.names[f], found]);
      else all[j][1] = worse(all[j][1], found);
    }));
    this.later.start([() => this.take(this.core), ...work, () => {
      this.margins = all;
      const worst = feedback > 0 ? all : [...all].sort((a, b) => (b[1]?.peak ?? 0) - (a[1]?.peak ?? 0));
      showSensitivity(this.plots["rotor-sensitivity"], this.cards["rotor-sensitivity"], worst);
    }]);
  }

  private lines(signal: Float64Array, T: number): void {
    const { f, amplitude } = spectrum(signal, T), once = this.settings.speed / (2 * Math.PI);
    this.plots.lines.show(f, [amplitude], [{ label: "A1", colour: "truth", width: 1.4 }], [], {
      unit: "amplitude [µm]", scale: 1e6, x: { label: "f [Hz]", log: true }, yLog: true, decades: true,
      draw: (u) => {
        if (!(once > f[0])) return;
        const by = window.devicePixelRatio || 1, x = u.valToPos(once, "x", true);
        u.ctx.save();
        u.ctx.strokeStyle = u.ctx.fillStyle = colour("accent");
        u.ctx.setLineDash([4 * by, 4 * by]);
        u.ctx.beginPath();
        u.ctx.moveTo(x, u.bbox.top);
        u.ctx.lineTo(x, u.bbox.top + u.bbox.height);
        u.ctx.stroke();
        u.ctx.font = `${11 * by}px system-ui, sans-serif`;
        u.ctx.fillText("1× speed", x + 5 * by, u.bbox.top + 13 * by);
        u.ctx.restore();
      },
    });
    this.cards.lines.say.textContent = `the rotor turns ${digits(once)} times a second`;
  }

  // ---- The interactive rotor ----

  private pointer(): void {
    const { svg } = this, where = (event: PointerEvent) => {
      const box = svg.getBoundingClientRect(), scale = Math.min(box.width / 360, box.height / 420);
      const x = (event.clientX - box.left - (box.width - 360 * scale) / 2) / scale, y = (event.clientY - box.top - (box.height - 420 * scale) / 2) / scale;
      return this.picture.at(x, y);
    };
    svg.addEventListener("pointerdown", (event) => {
      if (this.active) this.grabbed = where(event);
    });
    svg.addEventListener("pointermove", (event) => {
      if (this.active && this.grabbed) this.grabbed = where(event) ?? this.grabbed;
    });
    for (const name of ["pointerup", "pointercancel"] as const) svg.addEventListener(name, () => (this.grabbed = null));
  }

  /** A knock upwards or downwards at both bearings. */
  hit(way: number): void {
    const of = this.drawn, push = of.names.map(() => 0), at = radials(of), force = (way * 1.5 * of.mass * 9.81) / at.length;
    at.forEach((k) => alongAxes(of, k, force, 0).forEach((value, j) => (push[axesOf(of, k)[j]] = value)));
    this.knock = { push, samples: Math.max(1, Math.round(KNOCK / of.T)) };
  }

  private hand(): number[] {
    const of = this.drawn, push = of.names.map(() => 0);
    if (this.knock.samples > 0) return this.knock.push;
    if (!this.grabbed || !this.now) return push;
    const { bearing, up, right } = this.grabbed, [x, y] = across(of, bearing, this.now.s), at = axesOf(of, bearing), [k, s0, i0] = of.magnets[at[0]];
    const spring = (4 * k * i0 * i0) / s0 ** 3;
    alongAxes(of, bearing, spring * (up - x), spring * (right - y)).forEach((value, j) => (push[at[j]] = value));
    return push;
  }

  again(): void {
    this.off = false;
    this.live.start(kindsOf(this.settings)[0], true);
    this.picture.clear();
  }

  private frame(t: number): void {
    const passed = Math.min(0.05, (t - this.last) / 1000);
    this.last = t;
    if (this.active && this.running) {
      this.due += passed / this.slow / this.machine.T;
      let left = Math.min(1500, Math.floor(this.due));
      this.due -= Math.floor(this.due);
      const moved = left > 0;
      while (left > 0) {
        const push = this.hand(), some = this.knock.samples > 0 ? Math.min(left, this.knock.samples) : Math.min(left, 12);
        this.now = this.live.step(some, this.settings.speed, this.off, push);
        this.knock.samples -= some;
        left -= some;
        this.picture.move(this.now, push, this.off, true);
      }
      if (moved && this.now) this.read(this.now);
    }
    requestAnimationFrame((next) => this.frame(next));
  }

  /** Turn a knob by its name, as a user does; for tests. */
  turn(key: string, value: number): void {
    ROTOR_KNOBS(this.machine).find((one) => one.key === key)!.set(this.settings, value);
    this.change(false);
  }

  get knobs(): string[] {
    return ROTOR_KNOBS(this.machine).map((knob) => knob.key);
  }

  get charts(): [string, Chart][] {
    return Object.entries(this.plots);
  }

  get titles(): Record<string, string> {
    return Object.fromEntries(Object.entries(this.cards).map(([id, one]) => [id, one.head.querySelector("h2")!.textContent ?? ""]));
  }
}

/** Of two axes the one whose peak is higher. */
function worse(a: Sensitivity | null, b: Sensitivity | null): Sensitivity | null {
  return a && b ? (b.peak > a.peak ? b : a) : null;
}

function rms(series: Float64Array): number {
  const from = Math.floor(series.length / NIS_FROM);
  let sum = 0;
  for (let k = from; k < series.length; k++) sum += series[k] ** 2;
  return Math.sqrt(sum / (series.length - from));
}

/** A range about what is drawn once a filter has started. */
function settled(all: Float64Array[], scale = 1): (low: number, high: number) => [number, number] {
  let most = 0;
  for (const series of all) for (let k = Math.floor(series.length / 12); k < series.length; k++) most = Math.max(most, Math.abs(series[k]));
  return () => aroundZero(-scale * most, scale * most);
}
