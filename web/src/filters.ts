// The filters side by side, and their errors.

import { KINDS } from "./core";
import { lamp, type Figures } from "./panels";
import { FILTERS } from "./state";
import { digits, shown } from "./units";

/** The selected filters, the available ones, and their settings. */
export interface Choice {
  kinds(): number[];
  known(): number[];
  set(kinds: number[]): void;
}

const HEAD = "RMS errors against the truth; NIS is 1 where a filter knows how wrong it is";

export class FilterTable {
  private readonly body: HTMLElement;
  private readonly add: HTMLButtonElement;

  constructor(parent: HTMLElement, private readonly choice: Choice) {
    parent.innerHTML = `<div class="head"><h2>Filters on the same readings</h2><span class="say">${HEAD}</span></div>
      <div class="scroll"><table><thead><tr><th scope="col">filter</th><th scope="col">x</th><th scope="col">v</th><th scope="col">f_d</th><th scope="col">NIS</th><th scope="col"></th><th scope="col"></th></tr></thead><tbody></tbody></table></div>`;
    this.body = parent.querySelector("tbody")!;
    this.add = document.createElement("button");
    this.add.type = "button";
    this.add.textContent = "Add a filter";
    this.add.className = "add-filter";
    this.add.addEventListener("click", () => {
      const kinds = choice.kinds(), next = choice.known().find((kind) => !kinds.includes(kind));
      if (next !== undefined) choice.set([...kinds, next]);
    });
    parent.append(this.add);
  }

  show(all: Figures[]): void {
    const kinds = this.choice.kinds();
    const least = (key: "x" | "v" | "f_d") => Math.min(...all.map((one) => one[key]));
    const best = { x: least("x"), v: least("v"), f_d: least("f_d") };
    this.body.replaceChildren(...all.map((of, j) => this.row(kinds, j, of, best)));
    this.add.hidden = kinds.length >= FILTERS;
  }

  private row(kinds: number[], j: number, of: Figures, best: { x: number; v: number; f_d: number }): HTMLElement {
    const row = document.createElement("tr"), name = document.createElement("td"), swatch = document.createElement("span");
    swatch.className = "swatch";
    swatch.style.background = `var(--f${j})`;
    const choose = document.createElement("select");
    choose.setAttribute("aria-label", `Filter ${j + 1}${j === 0 ? ", in the loop" : ""}`);
    choose.append(...this.choice.known().map((kind) => new Option(KINDS[kind].label, String(kind))));
    choose.value = String(kinds[j]);
    choose.addEventListener("change", () => this.choice.set(kinds.map((kind, k) => (k === j ? Number(choose.value) : kind))));
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
    if (kinds.length > 1) {
      const remove = document.createElement("button");
      remove.type = "button";
      remove.className = "remove";
      remove.textContent = "×";
      remove.setAttribute("aria-label", `Remove ${KINDS[kinds[j]].label}`);
      remove.addEventListener("click", () => this.choice.set(kinds.filter((_, k) => k !== j)));
      last.append(remove);
    }
    row.append(nis, words, last);
    return row;
  }
}
