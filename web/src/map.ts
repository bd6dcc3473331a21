// The map of k_i or k_s over current and displacement, with the trajectory and the present
// operating point.

import type { Core, Flight } from "./core";
import type { Settings } from "./state";
import { colour } from "./charts";
import { digits } from "./units";

const CELLS = 44;

/** From dark to bright, legible with red-green colour blindness (after cividis). */
const RAMP = [[13, 39, 77], [59, 73, 108], [102, 105, 112], [144, 139, 117], [194, 176, 105], [253, 231, 85]];

function ramp(share: number): string {
  const at = Math.min(0.9999, Math.max(0, share)) * (RAMP.length - 1), k = Math.floor(at), part = at - k;
  return `rgb(${RAMP[k].map((value, j) => Math.round(value + part * (RAMP[k + 1][j] - value))).join(",")})`;
}

export class StiffnessMap {
  private readonly context: CanvasRenderingContext2D;
  private base: ImageData | null = null;
  private box = { left: 46, top: 8, width: 0, height: 0, iu: 1, x: 1, low: -1 };
  which: "k_i" | "k_s" = "k_i";
  tip = "";

  constructor(readonly canvas: HTMLCanvasElement) {
    this.context = canvas.getContext("2d", { willReadFrequently: true })!;
  }

  /** Draw the map of the magnet, and the trajectory of a run. */
  show(core: Core, s: Settings, flight: Flight | null): void {
    const by = window.devicePixelRatio || 1, width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    if (!width) return;
    this.canvas.width = width * by;
    this.canvas.height = height * by;
    const c = this.context, box = this.box;
    c.setTransform(by, 0, 0, by, 0, 0);
    c.clearRect(0, 0, width, height);
    Object.assign(box, { width: width - box.left - 74, height: height - box.top - 34, iu: s.p.current_limit, x: s.p.clearance });
    box.low = s.p.two_sided > 0 ? -box.iu : -Math.min(box.iu, s.p.i0);
    const values: number[] = [];
    for (let j = 0; j < CELLS; j++)
      for (let i = 0; i < CELLS; i++) {
        const iu = box.low + ((i + 0.5) / CELLS) * (box.iu - box.low), x = box.x - ((j + 0.5) / CELLS) * 2 * box.x;
        values.push(core.magnet(iu, x)[this.which]);
      }
    const sorted = [...values].sort((a, b) => a - b);
    const low = Math.max(sorted[0], 1e-9 * sorted[sorted.length - 1]), high = sorted[Math.floor(0.98 * (sorted.length - 1))];
    const share = (value: number) => Math.log(Math.max(value, low) / low) / Math.log(high / low || 1);
    values.forEach((value, k) => {
      const i = k % CELLS, j = Math.floor(k / CELLS);
      c.fillStyle = ramp(share(value));
      c.fillRect(box.left + (i * box.width) / CELLS, box.top + (j * box.height) / CELLS, box.width / CELLS + 0.7, box.height / CELLS + 0.7);
    });
    this.scales(c, low, high, height);
    if (flight) this.path(c, flight);
    this.base = c.getImageData(0, 0, this.canvas.width, this.canvas.height);
  }

  private scales(c: CanvasRenderingContext2D, low: number, high: number, height: number): void {
    const box = this.box, right = box.left + box.width + 10;
    c.font = "11px system-ui, sans-serif";
    c.fillStyle = colour("soft");
    c.textAlign = "right";
    for (const x of [-box.x, 0, box.x]) c.fillText(digits(x * 1e3, 2), box.left - 5, this.at(0, x)[1] + 4);
    c.textAlign = "center";
    for (const iu of [box.low, 0, box.iu]) c.fillText(digits(iu, 2), this.at(iu, 0)[0], box.top + box.height + 14);
    c.fillText("i_u [A]", box.left + box.width / 2, height - 4);
    c.save();
    c.translate(11, box.top + box.height / 2);
    c.rotate(-Math.PI / 2);
    c.fillText("x [mm]", 0, 0);
    c.restore();
    for (let k = 0; k < 60; k++) {
      c.fillStyle = ramp(1 - k / 59);
      c.fillRect(right, box.top + (k * box.height) / 60, 10, box.height / 60 + 1);
    }
    c.fillStyle = colour("soft");
    c.textAlign = "left";
    const by = this.which === "k_i" ? 1 : 1e-3;
    c.fillText(digits(high * by, 2), right + 14, box.top + 9);
    c.fillText(digits(low * by, 2), right + 14, box.top + box.height);
    c.fillText(this.which === "k_i" ? "N/A" : "N/mm", right + 14, box.top + box.height / 2 + 4);
  }

  private at(iu: number, x: number): [number, number] {
    const box = this.box;
    return [box.left + ((iu - box.low) / (box.iu - box.low)) * box.width, box.top + ((box.x - x) / (2 * box.x)) * box.height];
  }

  private path(c: CanvasRenderingContext2D, flight: Flight): void {
    const every = Math.max(1, Math.floor(flight.n / 1500));
    c.strokeStyle = "rgba(255,255,255,.75)";
    c.lineWidth = 1;
    c.beginPath();
    for (let k = 0; k < flight.n; k += every) c.lineTo(...this.at(flight.iu[k], flight.x[k]));
    c.stroke();
  }

  /** Draw the operating point over the map. */
  point(iu: number, x: number): void {
    if (!this.base) return;
    const c = this.context, [left, top] = this.at(iu, x);
    c.putImageData(this.base, 0, 0);
    c.beginPath();
    c.arc(left, top, 5, 0, 2 * Math.PI);
    c.fillStyle = colour("accent");
    c.fill();
    c.lineWidth = 2;
    c.strokeStyle = "#fff";
    c.stroke();
  }
}
