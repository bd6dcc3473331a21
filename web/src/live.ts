// The interactive rotor: animated in slow motion; it can be held, knocked and dropped.

import { colour } from "./charts";
import type { Core, Live, Parameters } from "./core";
import { Picture } from "./picture";
import type { Settings } from "./state";

const KEPT = 480; // points of the strip chart
const KNOCK = 0.004; // duration of a knock in seconds

export class Motion {
  running = true;
  active = true;
  off = false;
  slow = 30;
  now: Live | null = null;
  private settings!: Settings;
  private last = 0;
  private due = 0; // samples still to be computed
  private reached: number | null = null;
  private knock = { force: 0, samples: 0 };
  private readonly trace: [number, number, number][] = [];
  readonly picture: Picture;

  constructor(private readonly core: Core, svg: SVGSVGElement, private readonly strip: HTMLCanvasElement,
              private readonly moved: (live: Live, pushed: number) => void) {
    this.picture = new Picture(svg, {
      grab: (share) => (this.reached = share),
      release: (way) => {
        this.reached = null;
        if (way) this.hit(way);
      },
    });
    requestAnimationFrame((t) => this.frame(t));
  }

  /** Apply settings; `anew`: restart, else the rotor continues from its present state. */
  take(s: Settings, parameters: Parameters, anew: boolean): void {
    const another = this.settings?.machine !== s.machine || this.settings.p.s0 !== s.p.s0 || this.gap !== s.p.s0;
    this.settings = s;
    this.gap = s.p.s0;
    this.core.state({ ...parameters, reference: 0, load: 0 });
    this.core.liveSet(s.kinds[0], anew);
    if (another || anew) this.picture.build(s);
    if (anew) {
      this.trace.length = 0;
      this.off = false;
    }
    this.show(0);
  }

  private gap = 0;

  /** A force pulse upwards or downwards. */
  hit(way: number): void {
    const { p } = this.settings, change = 0.25 * p.clearance * Math.sqrt((4 * p.k * p.i0 ** 2) / p.s0 ** 3 / p.mass);
    this.knock = { force: (way * p.mass * change) / KNOCK, samples: Math.max(1, Math.round(KNOCK / p.T)) };
  }

  private hand(): number {
    if (this.knock.samples > 0) return this.knock.force;
    if (this.reached === null || !this.now) return 0;
    const { p } = this.settings, spring = (2 * p.k * p.i0 ** 2) / p.s0 ** 3;
    return spring * (this.reached * p.clearance - this.now.x);
  }

  private frame(t: number): void {
    const passed = Math.min(0.05, (t - this.last) / 1000);
    this.last = t;
    if (this.active && this.running && this.settings) {
      this.due += passed / this.slow / this.settings.p.T;
      const n = Math.min(2000, Math.floor(this.due));
      this.due -= n;
      if (n > 0) this.show(n);
    }
    requestAnimationFrame((next) => this.frame(next));
  }

  private show(n: number): void {
    const { p } = this.settings;
    let left = n;
    do {
      const some = this.knock.samples > 0 ? Math.min(left, this.knock.samples) : Math.min(left, 16), pushed = this.hand();
      this.now = this.core.liveStep(some, 0, pushed, this.off);
      this.knock.samples -= some;
      left -= some;
      if (left <= 0) this.picture.move(this.settings, this.now, pushed, this.off, this.reached);
    } while (left > 0);
    if (n > 0) this.trace.push([this.now.x / p.clearance, this.now.x_hat / p.clearance, this.now.y / p.K_sen / p.clearance]);
    if (this.trace.length > KEPT) this.trace.shift();
    this.draw();
    this.moved(this.now, this.hand());
  }

  private draw(): void {
    const c = this.strip.getContext("2d")!, by = window.devicePixelRatio || 1;
    const width = this.strip.clientWidth, height = this.strip.clientHeight;
    if (this.strip.width !== Math.round(width * by)) {
      this.strip.width = Math.round(width * by);
      this.strip.height = Math.round(height * by);
    }
    c.setTransform(by, 0, 0, by, 0, 0);
    c.clearRect(0, 0, width, height);
    const most = Math.max(0.08, ...this.trace.map(([x]) => Math.abs(x))) * 1.15;
    const at = (share: number) => height / 2 - (Math.max(-1.1, Math.min(1.1, share / most)) * height) / 2;
    c.strokeStyle = colour("line");
    c.beginPath();
    c.moveTo(0, at(0));
    c.lineTo(width, at(0));
    c.stroke();
    for (const [j, name, thick] of [[2, "sensor", 1], [0, "truth", 1.8], [1, "f0", 1.4]] as const) {
      c.strokeStyle = colour(name);
      c.lineWidth = thick;
      c.setLineDash(j === 1 ? [4, 3] : []);
      c.beginPath();
      this.trace.forEach((moment, k) => c.lineTo(width - ((this.trace.length - k) * width) / KEPT, at(moment[j])));
      c.stroke();
    }
    c.setLineDash([]);
  }
}
