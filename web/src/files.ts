// Files dropped onto the page, and downloads.

import type { App } from "./app";
import { ADAPTIVE, KINDS, MOST_SAMPLES } from "./core";
import { machineOf, toToml } from "./machine_file";
import { asPng, asSvg } from "./picture_file";
import { columnsOf, toCsv } from "./record";
import { fresh, fromHash, toHash } from "./state";
import { parse, type Table } from "./toml";
import { tuned } from "./tune";
import { quantity } from "./units";

const get = <T extends HTMLElement>(id: string) => document.getElementById(id) as T;

export class Files {
  constructor(private readonly app: App) {
    const drop = get("drop");
    let inside = 0;
    window.addEventListener("dragenter", (event) => {
      event.preventDefault();
      inside++;
      drop.hidden = false;
    });
    window.addEventListener("dragleave", () => (drop.hidden = --inside <= 0));
    window.addEventListener("dragover", (event) => event.preventDefault());
    window.addEventListener("drop", (event) => {
      event.preventDefault();
      inside = 0;
      drop.hidden = true;
      void this.all(event.dataTransfer?.files);
    });
    get<HTMLInputElement>("open").addEventListener("change", (event) => void this.all((event.target as HTMLInputElement).files));
    const press = (id: string, what: () => void | Promise<void>) =>
      get(id).addEventListener("click", () => {
        get<HTMLDetailsElement>("save").open = false;
        void what();
      });
    press("save-toml", () => this.save("toml", new Blob([toToml(app.settings, toHash(app.settings, app.machines))])));
    press("save-csv", () => {
      if (app.flight) this.save("csv", new Blob([toCsv(app.flight)]));
    });
    press("save-svg", () => this.save("svg", new Blob([this.picture()], { type: "image/svg+xml" })));
    press("save-png", async () => this.save("png", await asPng(this.picture())));
    press("link", async () => {
      const link = `${location.href.split("#")[0]}#${app.hash}`;
      try {
        await navigator.clipboard.writeText(link);
        app.say("The link is in the clipboard; it restores everything that is set.");
      } catch {
        app.say(`The link is in the address bar: ${link.slice(0, 120)}`);
      }
    });
  }

  private picture(): string {
    const { app } = this;
    if (app.mode === "rotor")
      return asSvg(app.motion.picture.svg, app.rotor.charts, app.rotor.titles, `ambkit workbench: ${get<HTMLSelectElement>("machine").value}`);
    const titles = Object.fromEntries(Object.entries(app.panels.cards).map(([id, card]) => [id, card.head.querySelector("h2")!.textContent ?? ""]));
    const filters = app.settings.kinds.map((kind) => KINDS[kind].label).join(", ");
    return asSvg(app.motion.picture.svg, app.panels.charts, titles, `ambkit workbench: ${app.settings.machine.name}; ${filters}; seed ${app.settings.seed}`);
  }

  private save(ends: string, blob: Blob): void {
    const link = document.createElement("a"), name = this.app.settings.machine.name.replace(/[^\w-]+/g, "_") || "machine";
    link.href = URL.createObjectURL(blob);
    link.download = `${name}.${ends}`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  }

  private async all(files: FileList | null | undefined): Promise<void> {
    for (const file of files ?? []) this.take(file.name, await file.text());
  }

  /** Read a file of any supported kind; errors are shown. */
  take(name: string, text: string): void {
    try {
      const table = name.endsWith(".csv") ? {} : parse(text);
      if (this.app.mode === "rotor" && (name.endsWith(".csv") || table.kind !== undefined))
        throw new Error("records and filters are of a machine with one axis; choose one first");
      if (name.endsWith(".csv")) return this.record(name, text);
      if (table.kind !== undefined) return this.filter(name, table);
      this.machine(name, table, text);
    } catch (error) {
      this.app.say(`${name}: ${(error as Error).message}`, true);
    }
  }

  private machine(name: string, table: Table, text: string): void {
    const { app } = this, kept = text.match(/^# workbench: (.*)$/m);
    const restored = kept && fromHash(kept[1], app.machines);
    if (restored) return app.choose(restored);
    const { machine, left } = machineOf(table);
    while (app.machines.some((one) => one.name === machine.name)) machine.name += " (dropped)";
    Object.assign(machine.axis, tuned(app.core, { ...machine.axis, feedback: 0 }, 0).gains);
    app.choose(fresh(machine));
    const without = left.length ? `, which the page simulates without ${left.join(", ")}` : "";
    requestAnimationFrame(() => requestAnimationFrame(() => app.say(`${name}: ${machine.name}${without}`, left.length > 0)));
  }

  private filter(name: string, table: Table): void {
    const { app } = this, kind = KINDS.findIndex((one) => one.name === table.kind);
    if (kind < 0 || (kind === ADAPTIVE && !app.settings.machine.expert)) throw new Error(`the page has no filter "${String(table.kind)}"; it has ${KINDS.map((one) => one.name).join(", ")}`);
    const noise = (table.noise ?? {}) as Table, own = app.core.assumed();
    app.settings.kinds = [kind, ...app.settings.kinds.filter((one) => one !== kind)].slice(0, 4);
    if (noise.measurement !== undefined) app.settings.R = quantity(noise.measurement) / own.R;
    if (noise.disturbance !== undefined) app.settings.Q = quantity(noise.disturbance) / own.Q;
    app.changed(true);
    requestAnimationFrame(() => requestAnimationFrame(() => app.say(`${name}: ${KINDS[kind].label} is in the loop, with its noise`)));
  }

  private record(name: string, text: string): void {
    const { app } = this, of = columnsOf(text, MOST_SAMPLES);
    app.replay(name, of);
  }
}
