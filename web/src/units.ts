// Quantities with units, read as in ambkit's TOML and displayed with a prefix.

const PREFIX: Record<string, number> = { n: 1e-9, u: 1e-6, "µ": 1e-6, "μ": 1e-6, m: 1e-3, c: 1e-2, k: 1e3, M: 1e6 };
const UNIT: Record<string, number> = {
  m: 1, s: 1, A: 1, V: 1, N: 1, T: 1, H: 1, W: 1, Hz: 1, rad: 1, g: 1e-3, ohm: 1,
  deg: Math.PI / 180, rpm: Math.PI / 30, min: 60, h: 3600, "%": 0.01, "1": 1,
};

function factor(symbol: string): number {
  const [, base, power] = symbol.match(/^(.+?)(?:\^(-?\d+))?$/) ?? [];
  if (!base) throw new Error(`"${symbol}" is no unit`);
  let value = UNIT[base];
  if (value === undefined) {
    const of = UNIT[base.slice(1)];
    if (of === undefined || !(base[0] in PREFIX)) throw new Error(`"${base}" is no unit`);
    value = PREFIX[base[0]] * of;
  }
  return value ** Number(power ?? 1);
}

/** A number in SI units from a number, or from a text such as "6.7 N mm^2/A^2". */
export function quantity(value: unknown): number {
  if (typeof value === "number") return value;
  const text = String(value).trim();
  const [, number, unit] = text.match(/^([-+]?[\d._]+(?:[eE][-+]?\d+)?)\s*(.*)$/) ?? [];
  if (number === undefined) throw new Error(`"${text}" is no quantity`);
  let result = Number(number.replaceAll("_", ""));
  let divides = false;
  for (const part of unit.replace(/[()]/g, "").split(/(\/|\s+|\*)/)) {
    if (part === "/") divides = true;
    else if (part.trim() && part !== "*") result *= divides ? 1 / factor(part) : factor(part);
  }
  if (!Number.isFinite(result)) throw new Error(`"${text}" is no quantity`);
  return result;
}

const SHOWN: [number, string][] = [[1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"]];

export function digits(value: number, count = 3): string {
  if (!Number.isFinite(value)) return "–";
  const text = value.toPrecision(count);
  if (text.includes("e")) return String(Number(text)).replace("e+", "e");
  return text.includes(".") ? text.replace(/\.?0+$/, "") : text;
}

/** "12.3 µm" for a value in SI; units with a power or a sum of symbols have no prefix. */
export function shown(value: number, unit: string, count = 3): string {
  if (!unit || unit === "1") return digits(value, count);
  if (unit === "m^2" || unit === "V^2") return `(${shown(Math.sqrt(value), unit[0], count)})²`;
  if (unit === "N m^2/A^2") return `${digits(value * 1e6, count)} N mm²/A²`;
  if (value === 0 || !/^[A-Za-z]+(\/m|\/A|\/s)?$/.test(unit)) return `${digits(value, count)} ${pretty(unit)}`;
  const size = Math.abs(value);
  if (unit === "A/m" || unit === "Hz" || unit === "rpm") return `${digits(value, count)} ${unit}`;
  const [by, prefix] = SHOWN.find(([by]) => size >= by * 0.9995) ?? SHOWN[SHOWN.length - 1];
  if (unit === "kg") return size < 1 ? `${digits(value * 1e3, count)} g` : `${digits(value, count)} kg`;
  return `${digits(value / by, count)} ${prefix}${unit}`.replace("-", "−");
}

export function pretty(unit: string): string {
  return unit.replaceAll("^2", "²").replaceAll("^3", "³");
}
