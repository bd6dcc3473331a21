// The page: settings, results, and their presentation.

import { ADAPTIVE, KINDS, type Core, type Flight, type Live, type Parameters } from "./core";
import { FilterTable } from "./filters";
import { Files } from "./files";
import { Guide } from "./guide";
import { fromSlider, KNOBS, slider } from "./knobs";
import { Motion } from "./live";
import { address, recall, remember } from "./memory";
import { figures, Panels } from "./panels";
import { fresh, fromHash, parameters, signals, STARTS, toHash, type Machine, type Settings } from "./state";
import type { Columns } from "./record";
import { RotorBench } from "./rotor_bench";
import type { RotorCore, RotorLive } from "./rotor_core";
import { rotorFromHash, rotorToHash, type RotorSettings } from "./rotor_knobs";
import { tuned } from "./tune";
import { shown } from "./units";

const get = <T extends HTMLElement>(id: string) => document.getElementById(id) as T;

export class App {
  mode: "axis" | "rotor" = "axis";
  settings!: Settings;
  own!: Settings; // of the machine, before any change
  flight: Flight | null = null;
  took = 0; // milliseconds of the last run with all charts
  readonly panels: Panels;
  readonly motion: Motion;
  readonly guide: Guide;
  readonly rotor: RotorBench;
  private rotorName = "";
  private readonly table: FilterTable;
  private readonly listed: { show(): void; hide?(): void }[] = [];
  private assumed = { R: 1, Q: 1 };
  private due = false;

  constructor(readonly core: Core, private readonly live: Core, rotor: RotorCore, rotorLive: RotorCore, readonly machines: Machine[]) {
    const theme = recall("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
    document.documentElement.classList.toggle("dark", theme === "dark");
    this.panels = new Panels(get("charts"));
    this.table = new FilterTable(get("filters"), {
      kinds: () => this.settings.kinds,
      known: () => KINDS.map((_, kind) => kind).filter((kind) => kind !== ADAPTIVE || this.settings.machine.expert),
      set: (kinds) => {
        this.settings.kinds = kinds;
        this.changed(true);
      },
    });
    this.motion = new Motion(live, document.querySelector<SVGSVGElement>("#picture")!, get<HTMLCanvasElement>("strip"), (now) => {
      this.panels.map.point(now.iu, now.x);
      this.readings(now);
      this.guide?.watch();
    });
    this.guide = new Guide(get("guide"), this);
    this.rotor = new RotorBench(rotor, rotorLive, document.querySelector<SVGSVGElement>("#picture")!, get("knobs"), get("charts"),
      () => address(this.hash), (text) => this.say(text), (now) => this.rotorReadings(now));
    for (const { element } of [...Object.values(this.panels.cards), { element: get("filters") }]) element.dataset.for = "axis";
    new Files(this);
    this.buttons();
    this.restore(location.hash);
    window.addEventListener("hashchange", () => {
      if (location.hash !== `#${this.hash}`) this.restore(location.hash);
    });
    window.addEventListener("message", ({ source, data }: MessageEvent<{ workbench?: unknown } | null>) => {
      if (source === parent && parent !== window && typeof data?.workbench === "string" && data.workbench !== this.hash) this.restore(data.workbench);
    });
    get("charts").addEventListener("redraw", () => this.compute());
  }

  /** The settings, as the part of a link behind #. */
  get hash(): string {
    return this.mode === "rotor" ? rotorToHash(this.rotor.settings, this.rotor.own, this.rotorName) : toHash(this.settings, this.machines);
  }

  /** Apply the settings of a link; without any, the first machine. */
  restore(hash: string): void {
    const parts = new URLSearchParams(hash.replace(/^#/, "")), named = this.machines.find((one) => one.name === parts.get("machine"));
    if (named?.rotor) return this.pick(named, rotorFromHash(parts, named.rotor));
    const s = fromHash(hash, this.machines);
    if (s) this.choose(s);
    else this.pick(this.machines[0]);
  }

  /** Select a machine with its own settings. */
  pick(machine: Machine, settings: Partial<RotorSettings> = {}): void {
    if (!machine.rotor) return this.choose(fresh(machine));
    this.turnTo("rotor", machine);
    this.rotorName = machine.name;
    this.rotor.choose(machine.rotor, settings);
  }

  private turnTo(mode: "axis" | "rotor", machine: Machine): void {
    this.mode = mode;
    document.body.dataset.mode = mode;
    this.rotor.active = mode === "rotor";
    this.motion.active = mode === "axis";
    const picker = get<HTMLSelectElement>("machine");
    picker.replaceChildren(...this.machines.map((one) => new Option(one.name, one.name)));
    picker.value = machine.name;
    get("description").textContent = machine.description;
    get("power").textContent = "Magnets on";
  }

  /** Apply settings, with sliders around the machine's own values. */
  choose(s: Settings): void {
    if (!this.machines.some((machine) => machine.name === s.machine.name)) this.machines.push(s.machine);
    this.settings = s;
    this.own = fresh(s.machine);
    this.turnTo("axis", s.machine);
    for (const core of [this.core, this.live]) core.setExpert(s.machine.expert);
    this.build();
    this.changed(true);
  }

  private build(): void {
    const panel = get("knobs"), s = () => this.settings;
    const opened = new Map([...panel.querySelectorAll("details")].map((one) => [one.dataset.group, one.open]));
    panel.replaceChildren();
    this.listed.length = 0;
    let box: HTMLDetailsElement | null = null;
    for (const knob of KNOBS) {
      if (box?.dataset.group !== knob.group) {
        box = document.createElement("details");
        box.dataset.group = knob.group;
        box.open = opened.get(knob.group) ?? (knob.group === "Controller" || innerWidth > 820);
        const head = document.createElement("summary");
        head.textContent = knob.group;
        box.append(head);
        panel.append(box);
        this.extras(knob.group, box);
      }
      const row = slider(knob, this.own, s, () => this.changed(false));
      box.append(row.row);
      this.listed.push(row);
    }
  }

  /** Controls of a group besides its sliders. */
  private extras(group: string, panel: HTMLElement): void {
    if (group === "Controller") {
      const tune = document.createElement("button");
      tune.type = "button";
      tune.id = "tune";
      tune.textContent = "Tune";
      tune.title = "The stiffest gains whose sensitivity stays low";
      tune.addEventListener("click", () => {
        Object.assign(this.settings.p, tuned(this.core, this.parameters(), this.settings.kinds[0]).gains);
        this.changed(false);
      });
      const row = this.choice("feedback", "Fed by", [["1", "first filter"], ["0", "sensor"]],
        () => String(this.settings.p.feedback), (value) => (this.settings.p.feedback = Number(value)), false);
      row.append(tune);
      panel.append(row);
    }
    if (group === "Flight") {
      panel.append(
        this.choice("start", "Starts", STARTS.map((start) => [start, { levitated: "levitated", landed: "lying on its stop", released: "released in the middle" }[start]]),
          () => this.settings.start, (value) => (this.settings.start = STARTS.find((start) => start === value) ?? "levitated"), true),
        this.choice("noise", "Noise", [["on", "on"], ["off", "off"]], () => (this.settings.noisy ? "on" : "off"), (value) => (this.settings.noisy = value === "on"), false),
      );
    }
  }

  private choice(id: string, text: string, options: string[][], now: () => string, set: (value: string) => void, anew: boolean): HTMLElement {
    const row = document.createElement("div"), label = document.createElement("label"), select = document.createElement("select");
    row.className = "choice";
    select.id = `choice-${id}`;
    label.htmlFor = select.id;
    label.textContent = text;
    select.append(...options.map(([value, name]) => new Option(name, value)));
    select.addEventListener("change", () => {
      set(select.value);
      this.changed(anew);
    });
    row.append(label, select);
    this.listed.push({ show: () => (select.value = now()) });
    return row;
  }

  parameters(): Parameters {
    return parameters(this.settings, this.assumed);
  }

  /** Settings have changed; `anew`: restart the interactive rotor. */
  changed(anew: boolean): void {
    this.core.state({ ...this.settings.p, filter_R: 0, filter_Q: 0 });
    this.assumed = this.core.assumed();
    this.motion.take(this.settings, this.parameters(), anew);
    this.listed.forEach((row) => row.show());
    this.powered();
    address(this.hash);
    if (this.due) return;
    this.due = true;
    requestAnimationFrame(() => {
      this.due = false;
      this.compute();
    });
  }

  /** Run, filter, and draw. */
  compute(): void {
    if (this.mode === "rotor") return this.rotor.compute();
    const from = performance.now(), { r, load } = signals(this.settings), p = this.parameters();
    this.flight = this.core.fly(p, r, load, this.settings.kinds);
    const flown = performance.now();
    if (!this.flight) return this.say("These settings are not possible: no filter can be made of them.", true);
    this.panels.show(this.core, this.settings, p, this.flight);
    this.table.show(this.flight.filters.map((of) => figures(this.flight!, of)));
    this.took = performance.now() - from;
    this.guide?.watch();
    this.say(`${this.settings.kinds.length} filters over ${this.flight.n.toLocaleString("en")} samples in ${(flown - from).toFixed(0)} ms, with all charts in ${this.took.toFixed(0)} ms`);
  }

  /** Run the filters over a record; truth is the recorded one, or else the first estimate. */
  replay(name: string, of: Columns): void {
    const { core, settings } = this, n = of.y.length, p: Parameters = { ...this.parameters(), T: of.T };
    const filters = core.filter(p, of.y, of.u, settings.kinds);
    if (!filters) return this.say(`${name}: no filter can be made of these settings for it`, true);
    const first = filters[0], state = (j: number) => Float64Array.from({ length: n }, (_, k) => first.mean[first.states * k + j]);
    const iu = of.u.map((value) => value * p.gain);
    this.flight = {
      n, T: of.T, r: new Float64Array(n), load: of.f_d ?? state(2), x: of.x ?? state(0), v: state(1), iu,
      force: iu.map((current, k) => core.magnet(current, first.mean[first.states * k]).force), y: of.y, u: of.u, atStop: new Uint8Array(n), filters,
    };
    this.panels.show(core, settings, p, this.flight);
    this.table.show(this.flight.filters.map((of) => figures(this.flight!, of)));
    this.say(`${name}: ${n.toLocaleString("en")} samples${of.x ? "" : "; without truth, errors are against the first filter"}. Turn a knob to fly again.`);
  }

  say(text: string, wrong = false): void {
    const status = get("status");
    status.textContent = text;
    status.classList.toggle("wrong", wrong);
  }

  redraw(): void {
    if (this.mode === "axis") this.motion.picture.build(this.settings);
    this.compute();
  }

  /** The numbers below the drawing. */
  private readings(now: Live): void {
    const { p } = this.settings, off = this.motion.off, two = p.two_sided > 0;
    const put = (id: string, text: string) => (get(id).textContent = text);
    put("now-x", shown(now.x, "m"));
    put("now-i", off ? "off" : two ? `${(p.i0 + now.iu).toFixed(2)} / ${(p.i0 - now.iu).toFixed(2)} A` : `${(p.i0 + now.iu).toFixed(3)} A`);
    put("now-f", shown(off ? 0 : now.force, "N"));
    put("now-d", `${shown(now.f_d_hat, "N", 2)} ± ${shown(2 * Math.sqrt(now.f_d_var), "N", 2)}`);
  }

  private rotorReadings(now: RotorLive): void {
    const put = (id: string, text: string) => (get(id).textContent = text), most = (of: number[]) => Math.max(...of.map(Math.abs));
    put("now-x", shown(most(now.s), "m"));
    put("now-i", this.rotor.off ? "off" : `± ${most(now.iu).toFixed(2)} A`);
    put("now-f", shown(this.rotor.off ? 0 : most(now.force), "N"));
  }

  private buttons(): void {
    const press = (id: string, what: () => void) => get(id).addEventListener("click", what);
    get<HTMLSelectElement>("machine").addEventListener("change", (event) => {
      const name = (event.target as HTMLSelectElement).value;
      this.pick(this.machines.find((machine) => machine.name === name)!);
    });
    press("play", () => this.play());
    press("power", () => this.power());
    press("lift", () => this.again());
    get<HTMLSelectElement>("slow").addEventListener("change", (event) => (this.motion.slow = this.rotor.slow = Number((event.target as HTMLSelectElement).value)));
    press("theme", () => {
      const dark = document.documentElement.classList.toggle("dark");
      remember("theme", dark ? "dark" : "light");
      this.redraw();
    });
    window.addEventListener("keydown", (event) => {
      const at = event.target as HTMLElement;
      if (["INPUT", "SELECT", "BUTTON", "SUMMARY"].includes(at.tagName) || event.ctrlKey || event.metaKey || event.altKey) return;
      const keys: Record<string, () => void> = {
        ArrowUp: () => this.moving.hit(1), ArrowDown: () => this.moving.hit(-1), " ": () => this.play(), m: () => this.power(),
        r: () => this.again(),
      };
      const action = keys[event.key] ?? keys[event.key.toLowerCase()];
      if (!action) return;
      event.preventDefault();
      action();
    });
  }

  /** Update the animation. */
  private get moving(): Motion | RotorBench {
    return this.mode === "rotor" ? this.rotor : this.motion;
  }

  private again(): void {
    if (this.mode === "rotor") this.rotor.again();
    else this.motion.take(this.settings, this.parameters(), true);
    this.powered();
  }

  private play(): void {
    const running = (this.motion.running = this.rotor.running = !this.motion.running);
    get("play").textContent = running ? "Pause" : "Play";
    get("play").setAttribute("aria-pressed", String(running));
  }

  private power(): void {
    this.moving.off = !this.moving.off;
    this.powered();
  }

  private powered(): void {
    get("power").setAttribute("aria-pressed", String(!this.moving.off));
    get("power").textContent = this.moving.off ? "Magnets off" : "Magnets on";
  }

  /** Set a control by its name, as a user does; for lessons and tests. */
  turn(key: string, value: number): void {
    const knob = KNOBS.find((one) => one.key === key);
    if (!knob) throw new Error(`there is no knob ${key}`);
    knob.set(this.settings, value);
    this.changed(false);
  }

  get knobs(): string[] {
    return KNOBS.map((knob) => knob.key);
  }

  /** The value of a control at a fraction of its range. */
  at(key: string, share: number): number {
    return fromSlider(KNOBS.find((one) => one.key === key)!, this.own, 1000 * share);
  }

  get filterNames(): string[] {
    return this.settings.kinds.map((kind) => KINDS[kind].name);
  }
}
