// Lessons and the challenge, in the panel above the charts.

import type { App } from "./app";
import { LESSONS } from "./lessons";
import { recall, remember } from "./memory";
import { fresh } from "./state";
import { digits, shown } from "./units";

type Mode = "none" | "lessons" | "challenge";

export class Guide {
  private mode: Mode = "none";
  private at = 0;
  private readonly reached = new Set<number>();
  private best = Number(recall("challenge") ?? 0);

  constructor(private readonly panel: HTMLElement, private readonly app: App) {
    for (const mode of ["lessons", "challenge"] as const)
      document.getElementById(mode)!.addEventListener("click", () => this.open(this.mode === mode ? "none" : mode));
  }

  private open(mode: Mode): void {
    this.mode = mode;
    for (const name of ["lessons", "challenge"]) document.getElementById(name)!.setAttribute("aria-expanded", String(name === mode));
    this.panel.hidden = mode === "none";
    this.mark([]);
    if (mode === "lessons") this.lesson(this.at);
    if (mode === "challenge") this.challenge();
  }

  private mark(ids: string[]): void {
    document.querySelectorAll(".watch").forEach((element) => element.classList.remove("watch"));
    for (const id of ids) {
      const element = document.getElementById(id);
      (element?.closest(".knob, .choice") ?? element)?.classList.add("watch");
    }
  }

  private start(machine: string, set: () => void): void {
    const { app } = this, of = app.machines.find((one) => one.name === machine) ?? app.machines.find((one) => !one.rotor)!;
    app.choose(fresh(of));
    set();
    app.changed(true);
  }

  private lesson(k: number): void {
    this.at = k;
    const lesson = LESSONS[k];
    this.reached.delete(k);
    this.start(lesson.machine, () => lesson.set(this.app));
    this.panel.innerHTML = '<ol></ol><h2></h2><p></p><p><b>Try:</b> <span class="task"></span> <span class="done" hidden>Done.</span></p><div class="row"></div>';
    const list = this.panel.querySelector("ol")!, row = this.panel.querySelector(".row")!;
    LESSONS.forEach((one, j) => {
      const item = document.createElement("li"), button = document.createElement("button");
      button.type = "button";
      button.textContent = `${j + 1} ${one.title}`;
      button.className = j === k ? "on" : "";
      button.addEventListener("click", () => this.lesson(j));
      item.append(button);
      list.append(item);
    });
    this.panel.querySelector("h2")!.textContent = lesson.title;
    this.panel.querySelector("p")!.textContent = lesson.text;
    this.panel.querySelector(".task")!.textContent = lesson.task;
    const next = document.createElement("button");
    next.type = "button";
    next.textContent = k + 1 < LESSONS.length ? "Next lesson" : "Close";
    next.addEventListener("click", () => (k + 1 < LESSONS.length ? this.lesson(k + 1) : this.open("none")));
    row.append(next);
    this.mark(lesson.watch);
  }

  private challenge(): void {
    this.start("inteco_ml", () => {
      this.app.settings.push = -0.1 * this.app.settings.p.mass * 9.81;
    });
    this.panel.innerHTML = `<h2>Hold the ball with the least current</h2><p>Half-way through the flight a force pulls the ball down. Hold it with as little copper loss as you can, and let it touch nothing.
      The score is 1000 × (1 − mean i² / i0²); it is 0 if the ball touches. Where the ball hangs, the gains, and the noise that your filter
      lets through all count. Mass, magnet and sensor must stay as they are.</p><p>Score <b class="score">–</b>, best <b class="best">–</b> <span class="why"></span></p>`;
    this.mark(["knob-reference", "knob-kp", "knob-kd"]);
    this.watch();
  }

  /** The score of the run; 0 with the reason if it does not count. */
  score(): { score: number; why: string } {
    const { app } = this, flight = app.flight, own = app.own;
    if (!flight) return { score: 0, why: "" };
    const fixed = ["T", "mass", "gravity", "clearance", "k", "s0", "i0", "noise_u", "noise_y", "lag", "step", "delay", "current_limit"];
    const changed = fixed.filter((key) => app.settings.p[key] !== own.p[key]);
    if (changed.length) return { score: 0, why: `(${changed.join(", ")} must stay as they are)` };
    if (!(app.settings.push <= -0.0999 * own.p.mass * 9.81) || !app.settings.noisy) return { score: 0, why: "(force and noise must stay)" };
    if (flight.atStop.some((at) => at > 0)) return { score: 0, why: "(it touches)" };
    let sum = 0;
    for (let k = 0; k < flight.n; k++) sum += (own.p.i0 + flight.iu[k]) ** 2;
    const mean = sum / flight.n;
    return { score: Math.max(0, Math.round(1000 * (1 - mean / own.p.i0 ** 2))), why: `(${shown(Math.sqrt(mean), "A")} RMS, bias ${digits(own.p.i0)} A)` };
  }

  /** Check whether the goal is reached. */
  watch(): void {
    if (this.app.mode === "rotor") return;
    if (this.mode === "lessons" && !this.reached.has(this.at) && LESSONS[this.at].done(this.app)) {
      this.reached.add(this.at);
      this.panel.querySelector<HTMLElement>(".done")!.hidden = false;
    }
    if (this.mode === "challenge") {
      const { score, why } = this.score(), put = (name: string, text: string) => {
        const element = this.panel.querySelector(name);
        if (element && element.textContent !== text) element.textContent = text;
      };
      if (score > this.best) remember("challenge", String((this.best = score)));
      put(".score", String(score));
      put(".best", String(this.best));
      put(".why", why);
    }
  }
}
