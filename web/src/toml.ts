// The subset of TOML that machines and filters need: tables, arrays of tables, strings, numbers,
// booleans, arrays.

export type Value = string | number | boolean | Value[] | Table;
export interface Table {
  [key: string]: Value;
}

export function parse(text: string): Table {
  const root: Table = Object.create(null) as Table;
  let at = root;
  text.split(/\r?\n/).forEach((raw, number) => {
    const line = strip(raw).trim();
    try {
      if (!line) return;
      const many = line.match(/^\[\[(.+)\]\]$/), one = line.match(/^\[(.+)\]$/);
      if (many) at = enter(root, many[1], true);
      else if (one) at = enter(root, one[1], false);
      else {
        const split = line.indexOf("=");
        if (split < 1) throw new Error("is no key = value");
        const path = keys(line.slice(0, split)), last = path.pop()!;
        path.reduce((table, key) => ((table[key] ??= Object.create(null)) as Table), at)[last] = value(line.slice(split + 1).trim());
      }
    } catch (error) {
      throw new Error(`line ${number + 1}: ${(error as Error).message}`);
    }
  });
  return root;
}

function strip(line: string): string {
  let quote = "";
  for (let k = 0; k < line.length; k++) {
    if (quote) {
      if (line[k] === "\\" && quote === '"') k++;
      else if (line[k] === quote) quote = "";
    } else if (line[k] === '"' || line[k] === "'") quote = line[k];
    else if (line[k] === "#") return line.slice(0, k);
  }
  return line;
}

const keys = (text: string) => text.split(".").map((key) => key.trim().replace(/^["'](.*)["']$/, "$1"));

function enter(root: Table, name: string, many: boolean): Table {
  const path = keys(name), last = path.pop()!;
  let at = root;
  for (const key of path) {
    const next = (at[key] ??= Object.create(null) as Table);
    at = (Array.isArray(next) ? next[next.length - 1] : next) as Table;
  }
  if (many) {
    const list = (at[last] ??= []) as Value[];
    list.push(Object.create(null) as Table);
    return list[list.length - 1] as Table;
  }
  return (at[last] ??= Object.create(null) as Table) as Table;
}

function value(text: string): Value {
  const quoted = text.match(/^"((?:[^"\\]|\\.)*)"$/);
  if (quoted) return JSON.parse(text) as string;
  if (/^'[^']*'$/.test(text)) return text.slice(1, -1);
  if (text === "true" || text === "false") return text === "true";
  if (/^\[.*\]$/.test(text)) return parts(text.slice(1, -1)).map(value);
  if (/^\{.*\}$/.test(text)) {
    const table: Table = Object.create(null) as Table;
    for (const part of parts(text.slice(1, -1))) {
      const split = part.indexOf("=");
      table[keys(part.slice(0, split))[0]] = value(part.slice(split + 1).trim());
    }
    return table;
  }
  const number = Number(text.replaceAll("_", ""));
  if (text === "" || Number.isNaN(number)) throw new Error(`"${text}" is no value`);
  return number;
}

function parts(text: string): string[] {
  const all: string[] = [];
  let depth = 0, quote = "", from = 0;
  for (let k = 0; k <= text.length; k++) {
    const c = text[k] ?? ",";
    if (quote) quote = c === quote ? "" : quote;
    else if (c === '"' || c === "'") quote = c;
    else if ("[{".includes(c)) depth++;
    else if ("]}".includes(c)) depth--;
    else if (c === "," && depth === 0) {
      if (text.slice(from, k).trim()) all.push(text.slice(from, k).trim());
      from = k + 1;
    }
  }
  return all;
}

/** A text in TOML notation, with any content. */
export const string = (text: string) => JSON.stringify(text).replace(/[\u007f-\u009f\u2028\u2029]/g, (c) => `\\u${c.charCodeAt(0).toString(16).padStart(4, "0")}`);
