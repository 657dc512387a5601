"use strict";
// Scales, frames, contours: what both pictures are drawn with.
const D = JSON.parse(document.getElementById("data").textContent);
const NS = "http://www.w3.org/2000/svg";
const by = id => document.getElementById(id);

function add(parent, tag, attributes, text) {
  const node = document.createElementNS(NS, tag);
  for (const key in attributes) node.setAttribute(key, attributes[key]);
  if (text !== undefined) node.textContent = text;
  parent.appendChild(node);
  return node;
}
function make(parent, tag, attributes, text) {
  const node = document.createElement(tag);
  for (const key in attributes) node.setAttribute(key, attributes[key]);
  if (text !== undefined) node.append(text);
  parent.appendChild(node);
  return node;
}
// "G_c/δ_c" with its subscripts, in HTML or in SVG text.
function symbol(node, text) {
  const svg = node.namespaceURI === NS;
  text.split(/_(\w+)/).forEach((part, n) => {
    if (!part) return;
    if (svg) add(node, "tspan", n % 2 ? { dy: "3", "font-size": "10" } : n ? { dy: "-3" } : {}, part);
    else if (n % 2) make(node, "sub", {}, part);
    else node.append(part);
  });
}
function show(value, unit) {
  if (value === null || value === undefined) return "\u2013";
  const text = String(Number(value.toPrecision(3))).replace("-", "\u2212");
  return text + (unit && unit !== "1" ? "\u00a0" + unit.replace("^2", "\u00b2").replace("mm2", "mm\u00b2") : "");
}
function percent(part) { return Number((100 * part).toPrecision(2)) + "\u00a0%"; }
function words(name) { return name.replace(/_/g, " "); }
for (const axis of D.axes) axis.label = axis.switch ? axis.symbol : words(axis.name);
function axisValue(k, value) {
  const axis = D.axes[k];
  return axis.switch ? (value ? "with" : "without") : show(value, axis.unit);
}

// A scale from values to pixels: place(v), its inverse, and the ticks that fit.
function scale(low, high, log, from, to) {
  if (!(high > low)) { const half = Math.abs(low) / 2 || 0.5; low -= half; high += half; log = false; }
  const f = log ? Math.log : v => v, g = log ? Math.exp : v => v, room = Math.abs(to - from);
  const place = v => from + (f(v) - f(low)) / (f(high) - f(low)) * (to - from);
  const value = p => g(f(low) + (p - from) / (to - from) * (f(high) - f(low)));
  let ticks = [];
  if (log) {
    const decades = Math.log10(high / low), many = room / decades > 110 ? [1, 2, 5] : [1];
    for (let p = Math.floor(Math.log10(low)); p <= Math.ceil(Math.log10(high)); p++)
      for (const m of many) ticks.push(Number((m * Math.pow(10, p)).toPrecision(6)));
    ticks = ticks.filter(t => t >= low * 0.999 && t <= high * 1.001);
  } else {
    const raw = (high - low) / Math.max(2, Math.min(6, room / 42)), ten = Math.pow(10, Math.floor(Math.log10(raw)));
    const step = [1, 2, 5, 10].map(m => m * ten).find(s => s >= raw);
    for (let t = Math.ceil(low / step - 1e-9) * step; t <= high + 1e-9 * step; t += step) ticks.push(Math.abs(t) < 1e-9 * step ? 0 : t);
  }
  return { place, value, ticks };
}
function frame(svg, sx, sy, b, xText, yText, tell = [show, show]) {
  add(svg, "rect", { x: b.left, y: b.top, width: b.width, height: b.height, class: "rule" });
  for (const t of xText === null ? [] : sx.ticks) {
    add(svg, "path", { d: `M${sx.place(t)},${b.top + b.height}v5`, class: "rule" });
    add(svg, "text", { x: sx.place(t), y: b.top + b.height + 18, "text-anchor": "middle" }, tell[0](t));
  }
  for (const t of sy.ticks) {
    add(svg, "path", { d: `M${b.left},${sy.place(t)}h-5`, class: "rule" });
    add(svg, "text", { x: b.left - 8, y: sy.place(t) + 4, "text-anchor": "end" }, tell[1](t));
  }
  if (xText !== null) symbol(add(svg, "text", { x: b.left + b.width / 2, y: b.top + b.height + 38, "text-anchor": "middle" }), xText);
  const middle = b.top + b.height / 2;
  symbol(add(svg, "text", { x: 13, y: middle, "text-anchor": "middle", transform: `rotate(-90 13 ${middle})` }), yText);
}
// Ratios count among positive values, and zero is a value like any.
function nearest(values, v) {
  const small = Math.min(...values.filter(u => u).map(Math.abs), Infinity), f = u => small < Infinity ? Math.asinh(u / small) : u;
  let best = 0;
  values.forEach((u, i) => { if (Math.abs(f(u) - f(v)) < Math.abs(f(values[best]) - f(v))) best = i; });
  return best;
}

// The line on which z, known at xs and ys (pixels), is 0; cells with gaps are passed over.
function contour(z, xs, ys) {
  const path = [], cut = (a, b, u, v) => u + (a / (a - b)) * (v - u);
  cells(z, (i, j, a, b, c, d) => {
    const hits = [];
    if ((a >= 0) !== (b >= 0)) hits.push([cut(a, b, xs[i], xs[i + 1]), ys[j]]);
    if ((b >= 0) !== (c >= 0)) hits.push([xs[i + 1], cut(b, c, ys[j], ys[j + 1])]);
    if ((d >= 0) !== (c >= 0)) hits.push([cut(d, c, xs[i], xs[i + 1]), ys[j + 1]]);
    if ((a >= 0) !== (d >= 0)) hits.push([xs[i], cut(a, d, ys[j], ys[j + 1])]);
    for (let n = 0; n + 1 < hits.length; n += 2) path.push("M" + hits[n].map(v => v.toFixed(1)) + "L" + hits[n + 1].map(v => v.toFixed(1)));
  });
  return path.join("");
}
// The area in which z is above 0, cell by cell.
function region(z, xs, ys, low = 0, high = Infinity) {
  const path = [];
  // What of a polygon of [value, x, y] lies above a value, or (way -1) below it.
  const cut = (ring, value, way) => ring.flatMap((p, n) => {
    const q = ring[(n + 1) % ring.length], f = way * (p[0] - value), g = way * (q[0] - value), kept = f > 0 ? [p] : [];
    if ((f > 0) !== (g > 0)) kept.push(p.map((v, k) => v + f / (f - g) * (q[k] - v)));
    return kept;
  });
  cells(z, (i, j, a, b, c, d) => {
    let ring = cut([[a, xs[i], ys[j]], [b, xs[i + 1], ys[j]], [c, xs[i + 1], ys[j + 1]], [d, xs[i], ys[j + 1]]], low, 1);
    if (high < Infinity) ring = cut(ring, high, -1);
    if (ring.length > 2) path.push("M" + ring.map(p => p.slice(1).map(v => v.toFixed(1)).join(",")).join("L") + "Z");
  });
  return path.join("");
}
function cells(z, take) {
  for (let j = 0; j + 1 < z.length; j++) for (let i = 0; i + 1 < z[0].length; i++) {
    const four = [z[j][i], z[j][i + 1], z[j + 1][i + 1], z[j + 1][i]];
    if (!four.includes(null)) take(i, j, ...four);
  }
}
// Cells of colour as one picture behind the lines; colour(v) is a CSS colour.
function shade(svg, z, xs, ys, b, colour) {
  const edge = (v, from, to) => v.map((p, i) => [i ? (v[i - 1] + p) / 2 : from, i + 1 < v.length ? (p + v[i + 1]) / 2 : to]);
  const canvas = document.createElement("canvas"), pen = canvas.getContext("2d"), fine = 2;
  canvas.width = fine * b.width; canvas.height = fine * b.height;
  const ex = edge(xs, b.left, b.left + b.width), ey = edge(ys, b.top + b.height, b.top), at = (p, from) => Math.round(fine * (p - from));
  z.forEach((row, j) => row.forEach((v, i) => {
    if (v === null) return;
    pen.fillStyle = colour(v, j, i);
    const x = ex[i].map(p => at(p, b.left)).sort((p, q) => p - q), y = ey[j].map(p => at(p, b.top)).sort((p, q) => p - q);
    pen.fillRect(x[0], y[0], x[1] - x[0], y[1] - y[0]);
  }));
  add(svg, "image", { x: b.left, y: b.top, width: b.width, height: b.height, href: canvas.toDataURL(), preserveAspectRatio: "none", class: "shade" });
}
function drops(part) {
  const n = D.drops.length - 1, k = Math.max(0, Math.min(n, Math.round(part * n * 8) / 8)), i = Math.min(n - 1, Math.floor(k));
  const rgb = hex => [1, 3, 5].map(p => parseInt(hex.slice(p, p + 2), 16)), a = rgb(D.drops[i]), c = rgb(D.drops[i + 1]);
  return `rgb(${a.map((v, m) => Math.round(v + (k - i) * (c[m] - v))).join(",")})`;
}
// A fill that is told from others by its lines as well as by its colour.
const HATCHES = ["", "M0,8L8,0M-2,2L2,-2M6,10L10,6", "M2,2h.1M6,6h.1", "M0,0L8,8M-2,6L2,10M6,-2L10,2", "M0,8L8,0M0,0L8,8", "M0,4h8", "M4,0v8", "M0,4h8M4,0v8"];
function pattern(svg, name, colour, n, ink) {
  const home = svg.querySelector("defs") || add(svg, "defs", {});
  const tile = add(home, "pattern", { id: name, width: 8, height: 8, patternUnits: "userSpaceOnUse" });
  if (colour) add(tile, "rect", { width: 8, height: 8, fill: colour });
  const d = HATCHES[n % HATCHES.length];
  if (d) add(tile, "path", { d, stroke: ink, "stroke-width": d.includes("h.1") ? 2 : 1, "stroke-linecap": "round", fill: "none" });
  return `url(#${name})`;
}
