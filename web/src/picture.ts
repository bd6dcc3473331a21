// Animated drawing of the machine: a ball below a magnet, or a collar between two.

import type { Live } from "./core";
import type { Settings } from "./state";
import { shown } from "./units";

const SVG = "http://www.w3.org/2000/svg";
const MIDDLE = 210, REACH = 44; // of the rotor, and its maximum displacement on the drawing
const ARROW = 74; // length of the longest arrow

function add(parent: Element, name: string, attributes: Record<string, string | number>, text?: string): SVGElement {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, String(value));
  if (text !== undefined) element.textContent = text;
  parent.append(element);
  return element;
}

interface Arrow {
  set(force: number, at: number): void;
}

/** What the drawing tells the page. */
export interface Hand {
  grab(share: number): void; // -1 to 1 of the reach, at the pointer
  release(knocked: number): void; // -1, 0, 1: a short tap below or above the rotor
}

export class Picture {
  private rotor!: SVGElement;
  private ghost!: SVGElement;
  private coils: SVGElement[] = [];
  private fields: SVGElement[] = [];
  private arrows: Record<string, Arrow> = {};
  private thread!: SVGElement;

  constructor(readonly svg: SVGSVGElement, hand: Hand) {
    let grabbed = 0, moved = false;
    const share = (event: PointerEvent) => {
      const box = svg.getBoundingClientRect(), view = svg.viewBox.baseVal;
      const scale = Math.min(box.width / view.width, box.height / view.height);
      const y = view.y + view.height / 2 + (event.clientY - box.top - box.height / 2) / scale;
      return Math.max(-2, Math.min(2, (MIDDLE - y) / REACH));
    };
    svg.addEventListener("pointerdown", (event) => {
      svg.setPointerCapture(event.pointerId);
      grabbed = event.timeStamp;
      moved = false;
      hand.grab(share(event));
    });
    svg.addEventListener("pointermove", (event) => {
      if (!grabbed) return;
      moved ||= Math.abs(event.movementY) > 1;
      hand.grab(share(event));
    });
    const end = (event: PointerEvent) => {
      if (!grabbed) return;
      const tapped = !moved && event.timeStamp - grabbed < 250;
      grabbed = 0;
      hand.release(tapped ? (share(event) > 0 ? -1 : 1) : 0);
    };
    svg.addEventListener("pointerup", end);
    svg.addEventListener("pointercancel", end);
  }

  /** Draw a machine; what moves is moved by `move`. */
  build(s: Settings): void {
    const svg = this.svg, two = s.p.two_sided > 0;
    svg.replaceChildren();
    svg.setAttribute("viewBox", two ? "0 34 360 352" : "0 66 360 262");
    this.coils = [];
    this.fields = [];
    add(svg, "title", {}, two ? "A thrust bearing: a collar between two electromagnets" : "A steel ball below an electromagnet");
    const gap = (s.p.s0 / s.p.clearance) * REACH; // from the centre to the pole, to scale
    if (two) this.thrust(gap, s);
    else this.ball(gap, s);
    this.stops(two);
    this.labels(s);
    const tones = { force: "accent", gravity: "soft", hand: "f2" };
    const place = { force: two ? 118 : 150, gravity: two ? 242 : 210, hand: two ? 146 : 180 };
    for (const [name, tone] of Object.entries(tones)) this.arrows[name] = this.arrow(name, tone, place[name as keyof typeof place]);
  }

  private magnet(top: number, down: boolean, left: number, right: number): void {
    // A laminated E-core with its coil; `top` is the pole face.
    const way = down ? 1 : -1, y = (at: number) => top - way * at;
    const core = `M${left} ${y(0)}V${y(66)}H${right}V${y(0)}H${right - 22}V${y(42)}H${left + 22}V${y(0)}Z`;
    const middle = (left + right) / 2;
    this.fields.push(add(this.svg, "path", {
      class: "field", d: `M${left + 11} ${y(-6)}V${y(54)}H${right - 11}V${y(-6)}`,
    }));
    add(this.svg, "path", { class: "iron", d: core });
    for (const x of [left - 7, right - 29]) {
      const coil = add(this.svg, "g", { class: "coil" });
      const from = Math.min(y(8), y(40));
      add(coil, "rect", { x, y: from, width: 36, height: 32, rx: 4 });
      for (let k = 1; k < 5; k++) add(coil, "line", { x1: x, x2: x + 36, y1: from + k * 6.4, y2: from + k * 6.4 });
      this.coils.push(coil);
    }
    add(this.svg, "line", { class: "axis-line", x1: middle, x2: middle, y1: y(0), y2: y(0) });
  }

  private ball(gap: number, _s: Settings): void {
    const radius = 34;
    this.magnet(MIDDLE - radius - Math.min(gap, 62), true, 112, 248);
    this.ghost = add(this.svg, "circle", { class: "ghost", cx: 180, r: radius });
    this.rotor = add(this.svg, "g", { class: "rotor" });
    const shade = add(this.svg, "defs", {});
    const gradient = add(shade, "radialGradient", { id: "steel", cx: "35%", cy: "30%", r: "75%" });
    add(gradient, "stop", { offset: "0%", class: "steel-1" });
    add(gradient, "stop", { offset: "100%", class: "steel-2" });
    add(this.rotor, "circle", { cx: 180, cy: 0, r: radius, fill: "url(#steel)" });
    add(this.rotor, "path", { class: "cross", d: "M172 0H188M180 -8V8" });
  }

  private thrust(gap: number, _s: Settings): void {
    const half = 13, face = half + Math.min(gap, 66);
    this.magnet(MIDDLE - face, true, 92, 162);
    this.magnet(MIDDLE - face, true, 198, 268);
    this.magnet(MIDDLE + face, false, 92, 162);
    this.magnet(MIDDLE + face, false, 198, 268);
    this.ghost = add(this.svg, "rect", { class: "ghost", x: 96, width: 168, height: 2 * half, rx: 4 });
    this.rotor = add(this.svg, "g", { class: "rotor" });
    const shade = add(this.svg, "defs", {});
    const gradient = add(shade, "linearGradient", { id: "steel" });
    for (const [at, tone] of [["0%", 2], ["40%", 1], ["100%", 2]]) add(gradient, "stop", { offset: at, class: `steel-${tone}` });
    add(this.rotor, "rect", { x: 169, y: -168, width: 22, height: 336, rx: 5, fill: "url(#steel)" });
    add(this.rotor, "rect", { x: 96, y: -half, width: 168, height: 2 * half, rx: 4, fill: "url(#steel)" });
    add(this.rotor, "path", { class: "cross", d: "M172 0H188M180 -8V8" });
  }

  private stops(two: boolean): void {
    const edge = two ? 13 : 34;
    const places = two ? [[74, 92], [268, 286]] : [[120, 240]];
    for (const way of two ? [-1, 1] : [-1]) {
      const y = MIDDLE - way * (REACH + edge);
      for (const [left, right] of places) {
        add(this.svg, "path", { class: "stop", d: `M${left} ${y}H${right}` });
        for (let x = left + 2; x < right; x += 6) add(this.svg, "path", { class: "stop thin", d: `M${x} ${y}l4 ${-way * 6}` });
      }
    }
  }

  private labels(s: Settings): void {
    const svg = this.svg;
    const axis = add(svg, "g", { class: "axis" });
    add(axis, "path", { d: `M300 ${MIDDLE + 62}V${MIDDLE - 62}m-5 9l5 -9l5 9` });
    for (const way of [-1, 1]) add(axis, "path", { d: `M295 ${MIDDLE - way * REACH}h10` });
    add(axis, "path", { d: `M295 ${MIDDLE}h10` });
    add(axis, "text", { x: 300, y: MIDDLE - 70, "text-anchor": "middle" }, "+x");
    add(axis, "text", { x: 310, y: MIDDLE + 4 }, "0");
    add(axis, "text", { x: 34, y: MIDDLE - 70, "text-anchor": "middle" }, "+u");
    add(axis, "path", { d: `M34 ${MIDDLE - 4}V${MIDDLE - 62}m-5 9l5 -9l5 9` });
    add(axis, "text", { x: 34, y: MIDDLE + 14, "text-anchor": "middle" }, "pulls up");
    add(axis, "text", { x: 310, y: MIDDLE - REACH + 4 }, shown(s.p.clearance, "m", 2));
    this.thread = add(svg, "path", { class: "thread", d: "" });
  }

  private arrow(name: string, tone: string, x: number): Arrow {
    const group = add(this.svg, "g", { class: `arrow ${tone}` });
    const line = add(group, "path", { d: "" });
    const text = add(group, "text", { x: x + 6 }, { force: "F", gravity: "g", hand: "f_d" }[name]);
    return {
      set(share, at) {
        const length = Math.sign(share) * Math.min(1, Math.abs(share)) ** 0.6 * ARROW;
        const seen = Math.abs(length) > 3;
        group.setAttribute("visibility", seen ? "visible" : "hidden");
        if (!seen) return;
        const tip = at - length, way = length > 0 ? 1 : -1;
        line.setAttribute("d", `M${x} ${at}V${tip}m-5 ${8 * way}l5 ${-8 * way}l5 ${8 * way}`);
        text.setAttribute("y", String(tip + (way > 0 ? -5 : 13)));
      },
    };
  }

  /** Show a moment; `pushed` is the force of the hand [N], `reached` where the pointer is. */
  move(s: Settings, live: Live, pushed: number, off: boolean, reached: number | null): void {
    const two = s.p.two_sided > 0, y = MIDDLE - (live.x / s.p.clearance) * REACH;
    const hat = MIDDLE - (live.x_hat / s.p.clearance) * REACH;
    this.rotor.setAttribute("transform", `translate(0 ${y.toFixed(2)})`);
    const seen = Number.isFinite(hat) && Math.abs(hat - MIDDLE) < 90;
    this.ghost.setAttribute(two ? "y" : "cy", (seen ? (two ? hat - 13 : hat) : -999).toFixed(2));
    const most = s.p.i0 + s.p.current_limit, upper = off ? 0 : (s.p.i0 + live.iu) / most, lower = off || !two ? 0 : (s.p.i0 - live.iu) / most;
    this.coils.forEach((coil, k) => (coil as SVGElement & ElementCSSInlineStyle).style.setProperty("--glow", (k < (two ? 4 : 2) ? upper : lower).toFixed(3)));
    this.fields.forEach((field, k) => (field as SVGElement & ElementCSSInlineStyle).style.setProperty("--glow", (k < (two ? 2 : 1) ? upper : lower).toFixed(3)));
    const weight = s.p.gravity * s.p.mass * 9.81, scale = Math.max(2 * Math.abs(weight), 2 * Math.abs(s.push), 1e-9);
    this.arrows.force.set((off ? 0 : live.force) / scale, y);
    this.arrows.gravity.set(weight / scale, y);
    this.arrows.hand.set(pushed / scale, y);
    const thread = reached === null ? "" : `M180 ${y}L180 ${MIDDLE - reached * REACH}`;
    this.thread.setAttribute("d", thread);
  }
}
