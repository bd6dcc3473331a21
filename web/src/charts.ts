// Charts over time, frequency and position, drawn by uPlot in the colours of the page.

import { digits } from "./units";
import uPlot from "../vendor/uplot/uPlot.esm.js";

export function colour(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

export interface Line {
  label: string;
  colour: string; // a name of style.css
  width?: number;
  dash?: number[];
  faint?: boolean;
  points?: boolean;
}

/** A band between two of the lines, counted from 1. */
export interface Band {
  upper: number;
  lower: number;
  colour: string;
}

export interface Axes {
  unit: string;
  scale: number; // shown = value * scale
  x?: { label: string; log?: boolean };
  yLog?: boolean;
  decades?: boolean; // no finer grid lines
  range?(low: number, high: number): [number, number];
  draw?(u: uPlot): void;
}

type Columns = (Float64Array | number[])[];

/** Minimum and maximum of each of at most so many intervals, for a line that many pixels wide. */
export function thinned(x: Float64Array | number[], columns: Columns, stretches: number): number[][] {
  const n = x.length;
  if (n <= 2 * stretches) return [Array.from(x), ...columns.map((column) => Array.from(column))];
  const out: number[][] = [[], ...columns.map(() => [])];
  for (let k = 0; k < stretches; k++) {
    const from = Math.floor((k * n) / stretches), to = Math.floor(((k + 1) * n) / stretches);
    out[0].push(x[from], x[(from + to) >> 1]);
    columns.forEach((column, j) => {
      let low = from, high = from;
      for (let i = from + 1; i < to; i++) {
        if (column[i] < column[low]) low = i;
        if (column[i] > column[high]) high = i;
      }
      out[j + 1].push(column[Math.min(low, high)], column[Math.max(low, high)]);
    });
  }
  return out;
}

export class Chart {
  private plot: uPlot | null = null;
  private shape = "";
  data: number[][] = [];
  lines: Line[] = [];
  axes: Axes | null = null;

  private readonly reading = document.createElement("div");

  constructor(readonly body: HTMLElement, private readonly sync: string | null = null) {
    this.reading.className = "reading-at";
    this.reading.setAttribute("aria-hidden", "true");
    new ResizeObserver(() => this.plot?.setSize(this.size())).observe(body);
  }

  private size() {
    return { width: Math.max(120, this.body.clientWidth), height: Math.max(100, this.body.clientHeight) };
  }

  /** Draw; the plot is created again only if its lines or colours have changed. */
  show(x: Float64Array | number[], columns: Columns, lines: Line[], bands: Band[], axes: Axes): void {
    const scaled = thinned(x, columns, Math.max(200, Math.min(900, this.body.clientWidth)));
    this.data = scaled.map((column, j) => (j === 0 || axes.scale === 1 ? column : column.map((value) => value * axes.scale)));
    this.lines = lines;
    this.axes = axes;
    const shape = JSON.stringify([lines, bands, axes.unit, axes.x, axes.yLog, axes.decades, colour("ink"), colour("card")]);
    if (!this.plot || shape !== this.shape) {
      this.plot?.destroy();
      this.shape = shape;
      this.plot = new uPlot(this.options(lines, bands), this.data as unknown as uPlot.AlignedData, this.body);
    } else this.plot.setData(this.data as unknown as uPlot.AlignedData);
  }

  get canvas(): HTMLCanvasElement | undefined {
    return this.plot?.ctx.canvas;
  }

  /** The values at the cursor. */
  private read(u: uPlot): void {
    const at = u.cursor.idx, left = u.cursor.left ?? -1;
    if (at === null || at === undefined || left < 0 || !u.over.matches(":hover")) return void this.reading.remove();
    const axes = this.axes!, [name] = (axes.x?.label ?? "t [s]").split(" ["), unit = (axes.x?.label ?? "t [s]").match(/\[(.*)\]/)?.[1] ?? "";
    const row = (tone: string, label: string, value: string) => {
      const line = document.createElement("div"), mark = document.createElement("i"), text = document.createElement("b");
      mark.style.background = tone ? `var(--${tone})` : "none";
      text.textContent = value;
      line.append(mark, label, text);
      return line;
    };
    const lines = this.lines.map((line, j) => row(line.colour, line.label, digits(this.data[j + 1][at])));
    this.reading.replaceChildren(row("", name, `${digits(this.data[0][at])} ${unit}`), ...lines);
    const right = left > u.over.clientWidth / 2;
    this.reading.style.cssText = right ? `right:${u.over.clientWidth - left + 12}px` : `left:${left + 12}px`;
    if (!this.reading.isConnected || this.reading.parentElement !== u.over) u.over.append(this.reading);
  }

  private options(lines: Line[], bands: Band[]): uPlot.Options {
    const axes = this.axes!, soft = colour("soft"), grid = colour("line"), font = `11px ${colour("font") || "sans-serif"}`;
    const whole = (_u: uPlot, splits: number[]) => splits.map((value) => (Math.abs(Math.log10(value) - Math.round(Math.log10(value))) < 1e-9 ? value : null));
    const axis = { stroke: soft, font, grid: { stroke: grid, width: 1 }, ticks: { stroke: grid, width: 1, size: 4 }, labelFont: font };
    const decades = { filter: whole, grid: { ...axis.grid, filter: whole }, ticks: { ...axis.ticks, filter: whole } };
    return {
      ...this.size(),
      padding: [8, 18, 0, 0],
      legend: { show: false },
      cursor: {
        ...(this.sync ? { sync: { key: this.sync } } : {}), points: { show: false }, drag: { x: true, y: false },
      },
      scales: {
        x: { time: false, ...(axes.x?.log ? { distr: 3 as const } : {}) },
        y: axes.yLog ? { distr: 3 } : axes.range ? { range: (_u, low, high) => this.axes!.range!(low, high) } : {},
      },
      axes: [
        { ...axis, size: 26, gap: 3, labelSize: 14, label: axes.x?.label ?? "t [s]", labelGap: -4, values: names, ...(axes.x?.log ? decades : {}) },
        { ...axis, size: 48, gap: 4, labelSize: 14, label: axes.unit, labelGap: 0, values: axes.decades ? powers : names, ...(axes.decades ? decades : {}) },
      ],
      series: [
        {},
        ...lines.map((line): uPlot.Series => ({
          label: line.label,
          stroke: colour(line.colour) + (line.faint ? "66" : ""),
          width: line.width ?? 1.5,
          dash: line.dash,
          points: { show: false },
        })),
      ],
      bands: bands.map((band) => ({ series: [band.upper, band.lower] as [number, number], fill: colour(band.colour) + "26" })),
      hooks: { draw: [(u) => this.axes?.draw?.(u)], setCursor: [(u) => this.read(u)] },
    };
  }
}

/** Ticks with plain numbers; a logarithmic axis omits some. */
function names(_u: uPlot, ticks: (number | null)[]): string[] {
  return ticks.map((value) => (value === null ? "" : digits(value)));
}

/** Decades, in a short form that fits any axis. */
function powers(_u: uPlot, ticks: (number | null)[]): string[] {
  return ticks.map((value) => (value === null ? "" : value < 0.01 ? `1e${Math.round(Math.log10(value))}` : digits(value)));
}

/** A symmetric range about zero that single outliers do not determine. */
export function aroundZero(low: number, high: number): [number, number] {
  const size = Math.max(Math.abs(low), Math.abs(high), 1e-12) * 1.08;
  return [-size, size];
}
