// A rotor on two bearings: from the side, and from its end at each bearing, where its orbit is drawn.

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

/** Upwards (x) and across (y) at a bearing, of numbers along its two axes. */
export function across(of: Rotor, bearing: number, along: number[]): [number, number] {
  const a = of.bearings[bearing].angle, [first, second] = [along[2 * bearing], along[2 * bearing + 1]];
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
  private disc!: SVGElement;
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
    const places = of.bearings.map((bearing) => bearing.place), all = [...places, ...of.discs];
    const low = Math.min(...all), high = Math.max(...all), room = 0.16 * (high - low);
    this.z = (place) => 24 + ((place - low + room) / (high - low + 2 * room)) * 312;
    const defs = add(svg, "defs", {}), steel = add(defs, "linearGradient", { id: "steel", x2: "0", y2: "1" });
    for (const [at, tone] of [["0%", 2], ["35%", 1], ["100%", 2]]) add(steel, "stop", { offset: at, class: `steel-${tone}` });
    this.coils = [];
    for (const bearing of of.bearings) this.magnets(this.z(bearing.place));
    this.shaft = add(svg, "g", { class: "rotor" });
    add(this.shaft, "rect", { x: 14, y: -7, width: 332, height: 14, rx: 4, fill: "url(#steel)" });
    for (const place of of.discs) add(this.shaft, "rect", { x: this.z(place) - 9, y: -34, width: 18, height: 68, rx: 3, fill: "url(#steel)" });
    this.disc = add(this.shaft, "rect", { x: this.z(of.discs[0] ?? 0) - 9, y: 0, width: 18, height: 4, class: "mark" });
    add(svg, "text", { x: 12, y: 20 }, "from the side, x up");
    this.ends = of.bearings.slice(0, 2).map((bearing, k) => this.end(k, bearing.name, k === 0 ? 96 : 264));
    this.words = add(svg, "text", { x: 180, y: 408, "text-anchor": "middle" });
    this.scale = VIEW / (of.rings[0]?.[2] ?? 1e-4);
  }

  private magnets(z: number): void {
    const pair: Style[] = [];
    for (const way of [-1, 1]) {
      const face = SIDE + way * 20;
      add(this.svg, "path", { class: "iron", d: `M${z - 20} ${face}v${way * 34}h40v${-way * 34}h-11v${way * 22}h-18v${-way * 22}z` });
      const coil = add(this.svg, "g", { class: "coil" }) as Style;
      for (const side of [-24, 6]) add(coil, "rect", { x: z + side, y: Math.min(face + way * 4, face + way * 20), width: 18, height: 16, rx: 3 });
      pair.push(coil);
    }
    this.coils.push(pair);
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
    const wanted = Math.min((0.62 * VIEW) / far, (30 * VIEW) / (of.rings[0]?.[2] ?? far));
    this.scale *= (wanted / this.scale) ** 0.08;
    const strongest = Math.max(...of.magnets.map(([, , i0]) => i0)), weight = of.mass * 9.81;
    this.ends.forEach((end, k) => {
      const [cx, cy] = end.centre, px = ([up, right]: [number, number]) => `${(cx + right * this.scale).toFixed(1)},${(cy - up * this.scale).toFixed(1)}`;
      const [up, right] = where[k], x = cx + right * this.scale, y = cy - up * this.scale;
      end.rotor.setAttribute("transform", `translate(${x.toFixed(2)} ${y.toFixed(2)})`);
      end.mark.setAttribute("cx", (7 * now.sine).toFixed(2));
      end.mark.setAttribute("cy", (-7 * now.cosine).toFixed(2));
      end.trail.setAttribute("points", end.points.map(px).join(" "));
      const radius = of.rings[end.bearing][2] * this.scale;
      end.stop.setAttribute("r", Math.min(radius, 400).toFixed(1));
      end.stop.setAttribute("visibility", radius < VIEW + 13 ? "visible" : "hidden");
      const arrow = (element: SVGElement, force: [number, number]) => {
        const size = Math.hypot(...force), length = (46 * Math.min(1, size / weight) ** 0.6) / (size || 1);
        element.setAttribute("d", size > 0.01 * weight ? `M${x} ${y}l${force[1] * length} ${-force[0] * length}` : "");
      };
      arrow(end.force, across(of, end.bearing, off ? now.force.map(() => 0) : now.force));
      arrow(end.hand, across(of, end.bearing, push));
    });
    const [a, b] = where.map(([up]) => up), [zA, zB] = of.bearings.map((bearing) => this.z(bearing.place));
    const slope = ((b - a) * this.scale * 0.55) / (zB - zA), level = SIDE - a * this.scale * 0.55;
    this.shaft.setAttribute("transform", `translate(0 ${level.toFixed(2)}) rotate(${((-Math.atan(slope) * 180) / Math.PI).toFixed(3)} ${zA} 0)`);
    this.disc.setAttribute("y", (30 * now.cosine - 2).toFixed(2));
    this.disc.setAttribute("visibility", now.sine > 0 ? "visible" : "hidden");
    this.coils.forEach((pair, k) => {
      const [up] = across(of, k, now.iu), i0 = of.magnets[2 * k][2];
      pair.forEach((coil, j) => coil.style.setProperty("--glow", off ? "0" : Math.max(0, Math.min(1, (i0 + (j === 0 ? up : -up)) / (2 * strongest))).toFixed(3)));
    });
    this.words.textContent = `the views are ${shown(VIEW / this.scale, "m", 2)} from the middle to the rim`;
  }
}
