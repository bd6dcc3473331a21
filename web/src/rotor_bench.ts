// The workbench of a rotor: its picture, knobs and charts.

import { aroundZero, Chart, colour, type Line } from "./charts";
import type { Card } from "./panels";
import { card, describe, lamp } from "./panels";
import { slider } from "./knobs";
import { orbits } from "./orbit";
import { along, type Rotor, type RotorCore, type RotorFlight, type RotorLive } from "./rotor_core";
import { described, filtering, freshRotor, ROTOR_KNOBS, type RotorSettings } from "./rotor_knobs";
import { across, alongAxes, RotorPicture } from "./rotor_picture";
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
    this.cards.orbits = card(charts, "orbits", "Orbits, last fifth of the flight");
    this.cards.orbits.element.dataset.for = "rotor";
    this.canvas.className = "map";
    this.cards.orbits.body.append(this.canvas);
    make("displacements", "Displacements along the axes");
    make("radius", "Orbit over time, or over speed");
    make("currents", "Control currents");
    make("rotor-force", "Disturbance forces, as the filter sees them");
    make("rotor-error", "Error of the first displacement");
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
        if (knob.group === "Filter") box.append(this.choice("filter", "Over the readings", [["2", "extended"], ["1", "linear"], ["0", "none"]],
          () => this.settings.filter, (value) => (this.settings.filter = value)));
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
    this.live.take(this.drawn, this.settings.seed, this.settings.noisy);
    if (anew) {
      this.live.start();
      this.picture.build(this.drawn);
    }
    this.rows.forEach((row) => row.show());
    this.changed();
    if (this.late) return;
    this.late = true;
    requestAnimationFrame(() => {
      this.late = false;
      if (this.active) this.compute();
    });
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
    this.core.take(this.drawn, this.settings.seed, this.settings.noisy);
    this.flight = this.core.fly(load, speed, filtering(this.machine, this.settings));
    const flown = performance.now() - from;
    this.show(this.flight, load);
    this.took = performance.now() - from;
    this.said(`${this.machine.axes} axes over ${this.flight.n.toLocaleString("en")} samples in ${flown.toFixed(0)} ms, with all charts in ${this.took.toFixed(0)} ms`);
  }

  private show(flight: RotorFlight, load: Float64Array): void {
    const of = this.drawn, { n, T } = flight, t = Float64Array.from({ length: n }, (_, k) => k * T);
    const s = of.names.map((_, f) => along(of, flight, f)), lines = of.names.map((name, f): Line => ({ label: name, colour: `f${f % 4}`, width: 1.2 }));
    this.plots.displacements.show(t, s, lines, [], { unit: "s [µm]", scale: 1e6, range: aroundZero });
    const touched = flight.atStop.some((at) => at > 0);
    this.cards.displacements.say.innerHTML = of.names.map((_, f) => `<i class="lamp" style="background:var(--f${f % 4})"></i><span></span>`).join(" ");
    this.cards.displacements.say.querySelectorAll("span").forEach((span, f) => (span.textContent = of.names[f]));
    const paths = of.bearings.slice(0, 2).map((bearing, k) => {
      const a = bearing.angle, first = s[2 * k], second = s[2 * k + 1];
      return {
        name: `bearing ${bearing.name}`, travel: of.rings[k][2],
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

  /** What the filter makes of the readings, against the truth. */
  private filtered(flight: RotorFlight, t: Float64Array, s: Float64Array, load: Float64Array): void {
    const of = this.drawn, { filter, n } = flight;
    for (const id of ["rotor-force", "rotor-error"]) this.cards[id].element.hidden = !filter;
    if (!filter) return;
    const { mean, states, innovation, variance } = filter, first = this.machine.filter!.loads;
    const column = (j: number) => Float64Array.from({ length: n }, (_, k) => mean[k * states + j]);
    const forces = of.names.map((_, f) => column(first + f)), truth = Float64Array.from({ length: n }, (_, k) => load[k * of.axes]);
    this.plots["rotor-force"].show(t, [...forces.reverse(), truth],
      [...of.names.map((name, f): Line => ({ label: name, colour: `f${f % 4}`, width: 1.2 })).reverse(), { label: `${of.names[0]}, truth`, colour: "truth", width: 1.8, dash: [5, 3] }],
      [], { unit: "f_d [N]", scale: 1, range: aroundZero });
    const [start, at, value] = of.H, hat = new Float64Array(n), reading = new Float64Array(n);
    for (let k = 0; k < n; k++) {
      let sum = 0;
      for (let j = start[0]; j < start[1]; j++) sum += value[j] * mean[k * states + at[j]];
      hat[k] = sum - s[k];
      reading[k] = flight.y[k * of.sensors] / of.gain[0] - s[k];
    }
    const from = Math.floor(n / 50), rms = (series: Float64Array) => Math.sqrt(series.slice(from).reduce((sum, one) => sum + one * one, 0) / (n - from));
    const beside = of.sensors === of.axes && rms(reading) < 5 * Math.sqrt(of.var_y[0]); // a sensor elsewhere shows another place
    this.plots["rotor-error"].show(t, beside ? [reading, hat] : [hat],
      [...(beside ? [{ label: "reading", colour: "sensor", width: 1, faint: true }] : []), { label: "filter", colour: "f0", width: 1.3 }], [],
      { unit: "error [µm]", scale: 1e6, range: aroundZero });
    this.cards["rotor-error"].say.textContent = `filter ${shown(rms(hat), "m")}${beside ? `, raw sensor ${shown(rms(reading), "m")}` : ""} RMS`;
    let sum = 0, taken = 0;
    for (let k = from * of.sensors; k < n * of.sensors; k++) {
      if (!(variance[k] > 0)) continue;
      sum += innovation[k] ** 2 / variance[k];
      taken++;
    }
    const nis = taken ? sum / taken : NaN, judged = lamp(nis);
    this.cards["rotor-force"].say.innerHTML = `<i class="lamp ${judged.tone}"></i>NIS ${digits(nis)}, ${judged.text}`;
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

  // ---- The rotor under the hand ----

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
    const of = this.drawn, push = of.names.map(() => 0), force = (way * 1.5 * of.mass * 9.81) / of.bearings.length;
    of.bearings.forEach((_, k) => {
      const [first, second] = alongAxes(of, k, force, 0);
      push[2 * k] = first;
      push[2 * k + 1] = second;
    });
    this.knock = { push, samples: Math.max(1, Math.round(KNOCK / of.T)) };
  }

  private hand(): number[] {
    const of = this.drawn, push = of.names.map(() => 0);
    if (this.knock.samples > 0) return this.knock.push;
    if (!this.grabbed || !this.now) return push;
    const { bearing, up, right } = this.grabbed, [x, y] = across(of, bearing, this.now.s), [k, s0, i0] = of.magnets[2 * bearing];
    const spring = (4 * k * i0 * i0) / s0 ** 3, [first, second] = alongAxes(of, bearing, spring * (up - x), spring * (right - y));
    push[2 * bearing] = first;
    push[2 * bearing + 1] = second;
    return push;
  }

  again(): void {
    this.off = false;
    this.live.start();
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

  // ---- Links ----

  toHash(name: string): string {
    const parts = new URLSearchParams({ machine: name });
    for (const [key, value] of Object.entries(this.settings)) if (value !== this.own[key as keyof RotorSettings]) parts.set(key, String(value));
    return parts.toString();
  }

  static fromHash(parts: URLSearchParams, machine: Rotor): Partial<RotorSettings> {
    const own = freshRotor(machine), out: Record<string, unknown> = {};
    for (const [key, text] of parts) {
      const known = own[key as keyof RotorSettings];
      if (typeof known === "number" && text !== "" && Number.isFinite(Number(text))) out[key] = Number(text);
      if (typeof known === "boolean") out[key] = text === "true";
    }
    return out as Partial<RotorSettings>;
  }
}
