// A record as CSV: columns t, y, u, and truth if known.

import type { Flight } from "./core";
import { quantity } from "./units";

export interface Columns {
  T: number;
  y: Float64Array;
  u: Float64Array;
  x?: Float64Array;
  f_d?: Float64Array;
}

/** Columns of a CSV file by the names of ambkit's records; the unit may follow a name, in brackets. */
export function columnsOf(text: string, most: number): Columns {
  const lines = text.split(/\r?\n/).filter((line) => line.trim() && !line.startsWith("#"));
  const separator = lines[0]?.includes(";") ? ";" : ",";
  const head = (lines[0] ?? "").split(separator).map((name) => name.trim().replace(/^"|"$/g, ""));
  const names = head.map((name) => name.replace(/\s*\[.*$/, ""));
  const rows = lines.slice(1, most + 1).map((line) => line.split(separator).map((cell) => (cell.trim() === "" ? NaN : Number(cell))));
  const column = (name: string) => {
    const at = names.indexOf(name);
    if (at < 0) return undefined;
    const by = quantity(`1 ${head[at].match(/\[(.*)\]/)?.[1] ?? ""}`);
    return Float64Array.from(rows, (row) => (row[at] ?? NaN) * by);
  };
  const [t, y, u] = [column("t"), column("y"), column("u")];
  if (!t || !y || !u) throw new Error(`a record has columns t [s], y [m] and u [V]; this one has ${names.join(", ")}`);
  if (t.length < 10) throw new Error(`a record has at least 10 samples, this one ${t.length}`);
  const T = (t[t.length - 1] - t[0]) / (t.length - 1);
  if (!(T > 0)) throw new Error("the times of a record grow");
  return { T, y, u, x: column("x"), f_d: column("f_d") };
}

/** A flight as CSV, every digit of it. */
export function toCsv(flight: Flight): string {
  const names = ["t [s]", "r [m]", "y [m]", "u [V]", "x [m]", "v [m/s]", "f_d [N]", "iu [A]", "f_mag [N]"];
  const columns = [flight.r, flight.y, flight.u, flight.x, flight.v, flight.load, flight.iu, flight.force];
  const rows = Array.from({ length: flight.n }, (_, k) => [k * flight.T, ...columns.map((column) => column[k])].join(","));
  return [names.join(","), ...rows, ""].join("\n");
}
