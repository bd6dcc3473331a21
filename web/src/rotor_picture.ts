// A rotor on two bearings: side view, and an end view at each bearing with its orbit.

import type { Rotor, RotorLive } from "./rotor_core";
import { shown } from "./units";

const SVG = "http://www.w3.org/2000/svg";
const TRAIL = 260, VIEW = 62, SIDE = 84;

function add(parent: Element, name: string, attributes: Record<string, string | number>, text?: string): SVGElement {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, String(value));
  if (text !== undefined) element.textContent = text;
  parent.append(element);
  return element;
}

type Style = SVGElement & ElementCSSInlineStyle;

interface End {
  centre: [number, number];
  bearing: number;
  rotor: SVGElement;
  mark: SVGElement;
  trail: SVGElement;
  stop: SVGElement;
  force: SVGElement;
  hand: SVGElement;
  points: [number, number][];
}

/** The axes of a bearing: two of a radial one, else one. */
export function axesOf(of: Rotor, bearing: number): number[] {
  const count = (k: number) => (of.bearings[k].type === "radial" ? 2 : 1);
  let first = 0;
  for (let k = 0; k < bearing; k++) first += count(k);
  return Array.from({ length: count(bearing) }, (_, j) => first + j);
}

export function radials(of: Rotor): number[] {
  return of.bearings.map((_, k) => k).filter((k) => of.bearings[k].type === "radial");
}

/** Upwards (x) and across (y) at a radial bearing, of numbers along its two axes. */
export function across(of: Rotor, bearing: number, along: number[]): [number, number] {
  const a = of.bearings[bearing].angle, [first, second] = axesOf(of, bearing).map((f) => along[f]);
  return [Math.cos(a) * first - Math.sin(a) * second, Math.sin(a) * first + Math.cos(a) * second];
}

/** And back. */
export function alongAxes(of: Rotor, bearing: number, up: number, right: number): [number, number] {
  const a = of.bearings[bearing].angle;
  return [Math.cos(a) * up + Math.sin(a) * right, -Math.sin(a) * up + Math.cos(a) * right];
}

export class RotorPicture {
  private ends: End[] = [];
  private shaft!: SVGElement;
  private line!: SVGElement;
  private discs: SVGElement[] = [];
  private disc!: SVGElement;
  private thrust: SVGElement | null = null;
  private coils: Style[][] = [];
  private words!: SVGElement;
  private scale = 1;
  private of!: Rotor;
  private z = (place: number) => place;

  constructor(private readonly svg: SVGSVGElement) {}

  build(of: Rotor): void {
    const svg = this.svg;
    this.of = of;
    svg.replaceChildren();
    svg.setAttribute("viewBox", "0 0 360 420");
    add(svg, "title", {}, "A rotor on two magnetic bearings, from the side and from its end at each bearing");
    const low = of.stations[0], high = of.stations[of.stations.length - 1];
    this.z = (place) => 20 + ((place - low) / (high - low)) * 320;
    const defs = add(svg, "defs", {}), steel = add(defs, "linearGradient", { id: "steel", x2: "0", y2: "1" });
    for (const [at, tone] of [["0%", 2], ["35%", 1], ["100%", 2]]) add(steel, "stop", { offset: at, class: `steel-${tone}` });
    const round = radials(of);
    this.coils = round.map((k) => this.magnets(this.z(of.bearings[k].place)));
    this.shaft = add(svg, "g", { class: "rotor" });
    add(this.shaft, "polyline", { class: "shaft-edge", points: "" });
    this.line = add(this.shaft, "polyline", { class: "shaft", points: "" });
    this.discs = of.discs.map((place) => {
      const disc = add(this.shaft, "g", {});
      add(disc, "rect", { x: this.z(place) - 9, y: -34, width: 18, height: 68, rx: 3, fill: "url(#steel)" });
      return disc;
    });
    this.disc = add(this.discs[0] ?? this.shaft, "rect", { x: this.z(of.discs[0] ?? 0) - 9, y: 0, width: 18, height: 4, class: "mark" });
    const thrust = of.bearings.find((bearing) => bearing.type === "thrust");
    this.thrust = thrust ? add(svg, "path", { class: "line accent", d: "" }) : null;
    if (thrust) add(svg, "text", { x: this.z(thrust.place), y: 176, "text-anchor": "middle" }, `thrust ${thrust.name}`);
    add(svg, "text", { x: 12, y: 20 }, of.modes.length ? `from the side, x up; bends at ${of.modes.slice(0, 3).map((f) => shown(f, "Hz")).join(", ")}${of.modes.length > 3 ? " ..." : ""}` : "from the side, x up");
    this.ends = round.slice(0, 2).map((k, j) => this.end(k, of.bearings[k].name, round.length < 2 ? 180 : j === 0 ? 96 : 264));
    this.words = add(svg, "text", { x: 180, y: 408, "text-anchor": "middle" });
    this.scale = VIEW / of.filter.view.clearance[0];
  }

  private magnets(z: number): Style[] {
    const pair: Style[] = [];
    for (const way of [-1, 1]) {
      const face = SIDE + way * 20;
      add(this.svg, "path", { class: "iron", d: `M${z - 20} ${face}v${way * 34}h40v${-way * 34}h-11v${way * 22}h-18v${-way * 22}z` });
      const coil = add(this.svg, "g", { class: "coil" }) as Style;
      for (const side of [-24, 6]) add(coil, "rect", { x: z + side, y: Math.min(face + way * 4, face + way * 20), width: 18, height: 16, rx: 3 });
      pair.push(coil);
    }
    return pair;
  }

  private end(bearing: number, name: string, x: number): End {
    const y = 282, group = add(this.svg, "g", {});
    add(group, "circle", { class: "view", cx: x, cy: y, r: VIEW + 14 });
    add(group, "path", { class: "hair", d: `M${x - VIEW - 8} ${y}h${2 * VIEW + 16}M${x} ${y - VIEW - 8}v${2 * VIEW + 16}` });
    const stop = add(group, "circle", { class: "stop", cx: x, cy: y, r: VIEW });
    const trail = add(group, "polyline", { class: "trail", points: "" });
    const rotor = add(group, "g", { class: "rotor" });
    add(rotor, "circle", { r: 11, fill: "url(#steel)" });
    const mark = add(rotor, "circle", { class: "mark", r: 3 });
    const force = add(group, "path", { class: "line accent", d: "" }), hand = add(group, "path", { class: "line f2", d: "" });
    add(group, "text", { x, y: y + VIEW + 32, "text-anchor": "middle" }, `bearing ${name}`);
    add(group, "text", { x: x + 5, y: y - VIEW - 2 }, "x");
    add(group, "text", { x: x + VIEW + 2, y: y - 5 }, "y");
    return { centre: [x, y], bearing, rotor, mark, trail, stop, force, hand, points: [] };
  }

  /** Which bearing is near a point of the drawing, and where on its view [m]: upwards and across. */
  at(x: number, y: number): { bearing: number; up: number; right: number } | null {
    const end = this.ends.find((one) => Math.hypot(x - one.centre[0], y - one.centre[1]) < VIEW + 30);
    return end ? { bearing: end.bearing, up: (end.centre[1] - y) / this.scale, right: (x - end.centre[0]) / this.scale } : null;
  }

  clear(): void {
    for (const end of this.ends) end.points.length = 0;
  }

  move(now: RotorLive, push: number[], off: boolean, fresh: boolean): void {
    const { of } = this, where = this.ends.map((end) => across(of, end.bearing, now.s));
    if (fresh) this.ends.forEach((end, k) => {
      end.points.push(where[k]);
      if (end.points.length > TRAIL) end.points.shift();
    });
    const far = Math.max(...this.ends.flatMap((end) => end.points.map(([up, right]) => Math.hypot(up, right))), 1e-9);
    const wanted = Math.min((0.62 * VIEW) / far, (30 * VIEW) / of.filter.view.clearance[0]);
    this.scale *= (wanted / this.scale) ** 0.08;
    const strongest = Math.max(...of.magnets.map(([, , i0]) => i0)), weight = of.mass * 9.81;
    this.ends.forEach((end, k) => {
      const [cx, cy] = end.centre, px = ([up, right]: [number, number]) => `${(cx + right * this.scale).toFixed(1)},${(cy - up * this.scale).toFixed(1)}`;
      const [up, right] = where[k], x = cx + right * this.scale, y = cy - up * this.scale;
      end.rotor.setAttribute("transform", `translate(${x.toFixed(2)} ${y.toFixed(2)})`);
      end.mark.setAttribute("cx", (7 * now.sine).toFixed(2));
      end.mark.setAttribute("cy", (-7 * now.cosine).toFixed(2));
      end.trail.setAttribute("points", end.points.map(px).join(" "));
      const radius = of.filter.view.clearance[axesOf(of, end.bearing)[0]] * this.scale;
      end.stop.setAttribute("r", Math.min(radius, 400).toFixed(1));
      end.stop.setAttribute("visibility", radius < VIEW + 13 ? "visible" : "hidden");
      const arrow = (element: SVGElement, force: [number, number]) => {
        const size = Math.hypot(...force), length = (46 * Math.min(1, size / weight) ** 0.6) / (size || 1);
        element.setAttribute("d", size > 0.01 * weight ? `M${x} ${y}l${force[1] * length} ${-force[0] * length}` : "");
      };
      arrow(end.force, across(of, end.bearing, off ? now.force.map(() => 0) : now.force));
      arrow(end.hand, across(of, end.bearing, push));
    });
    this.bend(now);
    this.disc.setAttribute("y", (30 * now.cosine - 2).toFixed(2));
    this.disc.setAttribute("visibility", now.sine > 0 ? "visible" : "hidden");
    radials(of).forEach((k, j) => {
      const [up] = across(of, k, now.iu), i0 = of.magnets[axesOf(of, k)[0]][2];
      this.coils[j].forEach((coil, side) => coil.style.setProperty("--glow", off ? "0" : Math.max(0, Math.min(1, (i0 + (side === 0 ? up : -up)) / (2 * strongest))).toFixed(3)));
    });
    if (this.thrust) {
      const k = of.bearings.findIndex((bearing) => bearing.type === "thrust"), [f] = axesOf(of, k);
      const length = (60 * now.s[f]) / of.filter.view.clearance[f], x = this.z(of.bearings[k].place);
      this.thrust.setAttribute("d", `M${x} 142v18M${x} 151h${length.toFixed(1)}`);
    }
    this.words.textContent = `radius of the views: ${shown(VIEW / this.scale, "m", 2)}`;
  }

  /** The shaft as it lies and bends, in the scale of the views. */
  private bend(now: RotorLive): void {
    const { of } = this, by = 0.55 * this.scale, height = (row: number[]) => SIDE - by * row.reduce((sum, share, j) => sum + share * now.q[j], 0);
    const heights = of.shape.x.map(height), points = heights.map((y, k) => `${this.z(of.stations[k]).toFixed(1)},${y.toFixed(2)}`).join(" ");
    this.line.setAttribute("points", points);
    this.line.previousElementSibling!.setAttribute("points", points);
    const step = (of.stations[of.stations.length - 1] - of.stations[0]) / (of.stations.length - 1);
    this.discs.forEach((disc, k) => {
      const at = Math.min(Math.max((of.discs[k] - of.stations[0]) / step, 0), of.stations.length - 1.001), i = Math.floor(at), share = at - i;
      const y = heights[i] * (1 - share) + heights[i + 1] * share, slope = (heights[i + 1] - heights[i]) / (this.z(of.stations[i + 1]) - this.z(of.stations[i]));
      disc.setAttribute("transform", `translate(0 ${y.toFixed(2)}) rotate(${((Math.atan(slope) * 180) / Math.PI).toFixed(3)} ${this.z(of.discs[k]).toFixed(1)} 0)`);
    });
  }
}
