// Orbits at the bearings: paths of the rotor's centre, within the touch-down bearing.

import { colour } from "./charts";
import { shown } from "./units";

export interface Path {
  name: string;
  up: Float64Array;
  right: Float64Array;
  travel: number; // [m]
}

/** Draw the last part of the orbits side by side, to the same scale. */
export function orbits(canvas: HTMLCanvasElement, paths: Path[], from: number): void {
  const c = canvas.getContext("2d")!, by = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  canvas.width = Math.round(width * by);
  canvas.height = Math.round(height * by);
  c.setTransform(by, 0, 0, by, 0, 0);
  let far = 1e-9;
  for (const path of paths) for (let k = from; k < path.up.length; k++) far = Math.max(far, Math.hypot(path.up[k], path.right[k]));
  const each = width / paths.length, radius = Math.min(each, height - 22) / 2 - 8, scale = radius / (1.1 * far);
  c.font = "11px system-ui, sans-serif";
  c.textAlign = "center";
  paths.forEach((path, j) => {
    const x = each * (j + 0.5), y = (height - 20) / 2 + 2;
    c.strokeStyle = colour("line");
    c.lineWidth = 1;
    c.beginPath();
    c.moveTo(x - radius, y);
    c.lineTo(x + radius, y);
    c.moveTo(x, y - radius);
    c.lineTo(x, y + radius);
    c.stroke();
    c.beginPath();
    c.arc(x, y, radius, 0, 2 * Math.PI);
    c.stroke();
    if (path.travel * scale < radius * 1.02) {
      c.strokeStyle = colour("bad");
      c.setLineDash([5, 4]);
      c.beginPath();
      c.arc(x, y, path.travel * scale, 0, 2 * Math.PI);
      c.stroke();
      c.setLineDash([]);
    }
    c.strokeStyle = colour(`f${j}`);
    c.lineWidth = 1.2;
    c.beginPath();
    for (let k = from; k < path.up.length; k++) c.lineTo(x + path.right[k] * scale, y - path.up[k] * scale);
    c.stroke();
    c.fillStyle = colour("soft");
    c.fillText(`${path.name}; rim ${shown(1.1 * far, "m", 2)}`, x, height - 5);
  });
}
