// The page's drawing and charts as one picture.

import { colour, type Chart } from "./charts";

const STYLED = ["fill", "stroke", "stroke-width", "stroke-dasharray", "opacity", "font-size", "font-weight", "stop-color", "visibility"];

/** A drawing as SVG that stands by itself: the styles of the page become its own. */
export function standing(svg: SVGSVGElement): string {
  const copy = svg.cloneNode(true) as SVGSVGElement;
  const from = [svg, ...svg.querySelectorAll("*")], to = [copy, ...copy.querySelectorAll("*")];
  from.forEach((element, k) => {
    const style = getComputedStyle(element);
    to[k].setAttribute("style", STYLED.map((name) => `${name}:${style.getPropertyValue(name)}`).join(";"));
  });
  copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
  copy.setAttribute("width", "360");
  copy.setAttribute("height", String(svg.viewBox.baseVal.height));
  copy.setAttribute("font-family", "system-ui, sans-serif");
  return new XMLSerializer().serializeToString(copy);
}

const escape = (text: string) => text.replace(/[&<>"']/g, (c) => `&#${c.charCodeAt(0)};`);

/** A chart as lines of SVG within a box. */
function chartLines(chart: Chart, title: string, left: number, top: number, width: number, height: number): string {
  const [x, ...columns] = chart.data, axes = chart.axes;
  if (!axes || !x?.length) return "";
  const log = Math.log10, fx = axes.x?.log ? log : (value: number) => value, fy = axes.yLog ? log : (value: number) => value;
  const values = columns.flat().filter((value) => Number.isFinite(value) && (!axes.yLog || value > 0)).map(fy);
  let low = values.reduce((a, b) => Math.min(a, b), Infinity), high = values.reduce((a, b) => Math.max(a, b), -Infinity);
  if (axes.range) [low, high] = axes.range(low, high);
  const inner = { left: left + 56, top: top + 24, width: width - 66, height: height - 56 };
  const px = (value: number) => inner.left + ((fx(value) - fx(x[0])) / (fx(x[x.length - 1]) - fx(x[0]))) * inner.width;
  const py = (value: number) => inner.top + (1 - (fy(value) - low) / (high - low || 1)) * inner.height;
  const out = [`<text x="${left + 4}" y="${top + 14}" font-weight="650" fill="${colour("ink")}">${escape(title)}</text>`,
    `<rect x="${inner.left}" y="${inner.top}" width="${inner.width}" height="${inner.height}" fill="none" stroke="${colour("line")}"/>`];
  const tick = (value: number) => String(Number(value.toPrecision(3)));
  const real = (value: number) => (axes.yLog ? 10 ** value : value);
  for (const [k, value] of [low, (low + high) / 2, high].entries())
    out.push(`<text x="${inner.left - 5}" y="${inner.top + inner.height * (1 - k / 2) + 4}" text-anchor="end" fill="${colour("soft")}">${tick(real(value))}</text>`);
  for (const at of [x[0], x[x.length - 1]])
    out.push(`<text x="${px(at)}" y="${inner.top + inner.height + 15}" text-anchor="middle" fill="${colour("soft")}">${tick(at)}</text>`);
  out.push(`<text x="${inner.left + inner.width / 2}" y="${inner.top + inner.height + 15}" text-anchor="middle" fill="${colour("soft")}">${escape(`${axes.x?.label ?? "t [s]"}, ${axes.unit}`)}</text>`);
  const clip = `clip-${Math.round(left)}-${Math.round(top)}`;
  out.push(`<clipPath id="${clip}"><rect x="${inner.left}" y="${inner.top}" width="${inner.width}" height="${inner.height}"/></clipPath><g clip-path="url(#${clip})">`);
  chart.lines.forEach((line, j) => {
    const points = x.map((at, k) => `${px(at).toFixed(1)},${py(columns[j][k]).toFixed(1)}`).filter((point) => !point.includes("NaN") && !point.includes("Inf"));
    out.push(`<polyline points="${points.join(" ")}" fill="none" stroke="${colour(line.colour)}" stroke-width="${line.width ?? 1.5}"${line.faint ? ' opacity=".4"' : ""}${line.dash ? ` stroke-dasharray="${line.dash.join(" ")}"` : ""}><title>${escape(line.label)}</title></polyline>`);
  });
  return `${out.join("")}</g>`;
}

/** Drawing and charts in one SVG. */
export function asSvg(svg: SVGSVGElement, charts: [string, Chart][], titles: Record<string, string>, caption: string): string {
  const width = 1400, columns = 2, wide = (width - 380) / columns, high = 230;
  const rows = Math.ceil(charts.length / columns), height = Math.max(470, rows * high + 40);
  const parts = charts.map(([id, chart], k) => chartLines(chart, titles[id], 380 + (k % columns) * wide, 8 + Math.floor(k / columns) * high, wide - 12, high - 10));
  return `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${height}" font-family="system-ui, sans-serif" font-size="11"><rect width="100%" height="100%" fill="${colour("card")}"/><g transform="translate(8 8)">${standing(svg)}</g>${parts.join("")}<text x="14" y="${height - 12}" fill="${colour("soft")}">${escape(caption)}</text></svg>`;
}

/** The same as PNG, twice as fine as it is shown. */
export async function asPng(text: string): Promise<Blob> {
  const image = new Image(), url = URL.createObjectURL(new Blob([text], { type: "image/svg+xml" }));
  const [, width, height] = text.match(/viewBox="0 0 (\d+) (\d+)"/)!.map(Number);
  try {
    image.src = url;
    await image.decode();
    const canvas = document.createElement("canvas");
    canvas.width = 2 * width;
    canvas.height = 2 * height;
    canvas.getContext("2d")!.drawImage(image, 0, 0, canvas.width, canvas.height);
    return await new Promise((done, failed) => canvas.toBlob((blob) => (blob ? done(blob) : failed(new Error("no picture"))), "image/png"));
  } finally {
    URL.revokeObjectURL(url);
  }
}
