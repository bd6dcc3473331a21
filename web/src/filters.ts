// The filters side by side: which they are, and how far each is from the truth.

import { ADAPTIVE, KINDS, type Flight } from "./core";
import { figures, lamp } from "./panels";
import { FILTERS, type Settings } from "./state";
import { digits, shown } from "./units";

export class FilterTable {
  private readonly body: HTMLElement;
  private readonly add: HTMLButtonElement;

  constructor(parent: HTMLElement, private readonly now: () => Settings, private readonly changed: () => void) {
    parent.innerHTML = `<div class="head"><h2>Filters on the same readings</h2><span class="say">RMS errors against the truth; NIS is 1 where a filter knows how wrong it is</span></div>
      <div class="scroll"><table><thead><tr><th scope="col">filter</th><th scope="col">x</th><th scope="col">v</th><th scope="col">f_d</th><th scope="col">NIS</th><th scope="col"></th><th scope="col"></th></tr></thead><tbody></tbody></table></div>`;
    this.body = parent.querySelector("tbody")!;
    this.add = document.createElement("button");
    this.add.type = "button";
    this.add.textContent = "Add a filter";
    this.add.id = "add-filter";
    this.add.addEventListener("click", () => {
      const { kinds } = this.now();
      kinds.push(KINDS.findIndex((_, kind) => !kinds.includes(kind) && kind !== ADAPTIVE));
      this.changed();
    });
    parent.append(this.add);
  }

  show(flight: Flight): void {
    const all = flight.filters.map((of) => figures(flight, of));
    const least = (key: "x" | "v" | "f_d") => Math.min(...all.map((one) => one[key]));
    const best = { x: least("x"), v: least("v"), f_d: least("f_d") };
    this.body.replaceChildren(...flight.filters.map((of, j) => this.row(of.kind, j, all[j], best)));
    this.add.hidden = flight.filters.length >= FILTERS;
  }

  private row(kind: number, j: number, of: { x: number; v: number; f_d: number; nis: number }, best: { x: number; v: number; f_d: number }): HTMLElement {
    const row = document.createElement("tr"), name = document.createElement("td"), swatch = document.createElement("span");
    swatch.className = "swatch";
    swatch.style.background = `var(--f${j})`;
    const choose = document.createElement("select");
    choose.setAttribute("aria-label", `Filter ${j + 1}${j === 0 ? ", in the loop" : ""}`);
    const known = KINDS.map((one, k) => new Option(one.label, String(k)));
    choose.append(...known.filter((_, k) => k !== ADAPTIVE || this.now().machine.expert));
    choose.value = String(kind);
    choose.addEventListener("change", () => {
      this.now().kinds[j] = Number(choose.value);
      this.changed();
    });
    name.append(swatch, choose, j === 0 ? " in the loop" : "");
    row.append(name);
    for (const [key, unit] of [["x", "m"], ["v", "m/s"], ["f_d", "N"]] as const) {
      const cell = document.createElement("td");
      cell.textContent = shown(of[key], unit);
      cell.classList.toggle("best", of[key] <= best[key] * 1.01);
      row.append(cell);
    }
    const judged = lamp(of.nis), nis = document.createElement("td"), words = document.createElement("td"), last = document.createElement("td");
    nis.textContent = digits(of.nis);
    words.style.textAlign = "left";
    words.innerHTML = `<i class="lamp ${judged.tone}"></i>${judged.text}`;
    if (this.now().kinds.length > 1) {
      const remove = document.createElement("button");
      remove.type = "button";
      remove.className = "remove";
      remove.textContent = "×";
      remove.setAttribute("aria-label", `Remove ${KINDS[kind].label}`);
      remove.addEventListener("click", () => {
        this.now().kinds.splice(j, 1);
        this.changed();
      });
      last.append(remove);
    }
    row.append(nis, words, last);
    return row;
  }
}
