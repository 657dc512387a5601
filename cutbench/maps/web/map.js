// The map: axes, layers, runs, materials; and which run is chosen.
const state = { x: D.x, y: D.y, level: {}, shade: D.layers.drop ? "drop" : "none", chosen: null, held: false };
let view = null;

function others() { return D.gridded ? D.axes.map((_, k) => k).filter(k => k !== state.x && k !== state.y) : []; }
// Levels of an axis that is not drawn: where the boundary was sought, those of the estimate.
function levels(k) { return D.sought ? D.layers.chance.values[k] : D.axes[k].values; }
function visible(item) {
  return others().every(k => nearest(levels(k), item.at[k]) === state.level[k]);
}
function ends(k) {
  const values = D.axes[k].values, low = Math.min(...values), high = Math.max(...values);
  if (low === high) return [low, high];
  const pad = D.gridded && !D.sought ? 0.5 / (values.length - 1) : 0.03;
  if (D.axes[k].log) { const r = Math.pow(high / low, pad); return [low / r, high * r]; }
  return [low - pad * (high - low), high + pad * (high - low)];
}
// A layer's numbers on the plane that is shown: rows of y, columns of x.
function plane(layer, key) {
  const sizes = layer.values.map(v => v.length), stride = sizes.map((_, k) => sizes.slice(k + 1).reduce((a, b) => a * b, 1));
  let offset = 0;
  for (const k of others()) offset += nearest(layer.values[k], levels(k)[state.level[k]]) * stride[k];
  return layer.values[state.y].map((_, j) => layer.values[state.x].map((_, i) => {
    const v = layer[key][offset + i * stride[state.x] + j * stride[state.y]];
    return v === null ? null : v / 1000;
  }));
}
// How likely a margin with this standard deviation is above 0 (Abramowitz & Stegun 26.2.17).
function chance(margin, sd) {
  const z = Math.abs(margin) / Math.max(sd, 1e-3), t = 1 / (1 + 0.2316419 * z);
  const tail = Math.exp(-z * z / 2) / 2.5066 * t * (0.31938153 + t * (-0.356563782 + t * (1.781477937 + t * (-1.821255978 + t * 1.330274429))));
  return margin > 0 ? 1 - tail : tail;
}
function top() {
  const largest = Math.max(0, ...D.points.map(p => drop(p) || 0));
  return Math.min(1, Math.max(Math.ceil(10 * largest - 1e-9) / 10, 2 * D.threshold));
}
function measure(point, name) { const n = D.numbers.findIndex(m => m.name === name); return n < 0 ? null : point.measures[n]; }
function drop(point) { return measure(point, "drop_rel"); }
function labelOf(point) { return !point.outcome ? "no run of its own" : point.outcome === "missing" ? "to come" : (point.label === "uncut" ? "not cut" : point.label.replace("_", " ")); }

function draw() {
  const svg = by("map"), width = Math.max(300, by("left").clientWidth), narrow = width < 480;
  const b = { left: (narrow ? 52 : 66) + (state.y >= 0 && D.axes[state.y].switch ? 16 : 0), top: 10, width: 0, height: 0 };
  b.width = width - b.left - 14; b.height = Math.round(Math.min(0.86 * b.width, 460));
  const height = b.top + b.height + 46;
  const focused = document.activeElement && document.activeElement.dataset ? document.activeElement.dataset.id : null;
  svg.replaceChildren();
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`); svg.setAttribute("height", height);
  const sx = scale(...ends(state.x), D.axes[state.x].log, b.left, b.left + b.width), flat = state.y < 0;
  const sy = flat ? scale(-0.04, top(), false, b.top + b.height, b.top) : scale(...ends(state.y), D.axes[state.y].log, b.top + b.height, b.top);
  const yOf = flat ? p => sy.place(drop(p) === null ? (p.mark ? D.threshold : 0) : drop(p)) : p => sy.place(p.at[state.y]);
  const told = [state.x, state.y].map(k => k >= 0 && D.axes[k].switch ? v => axisValue(k, v) : v => show(v));
  for (const [s, k] of [[sx, state.x], [sy, state.y]]) if (k >= 0 && D.axes[k].switch) s.ticks = D.axes[k].values;
  view = { b, sx, sy, yOf };
  const hole = add(add(svg, "defs", {}), "clipPath", { id: "inside" });
  add(hole, "rect", { x: b.left, y: b.top, width: b.width, height: b.height });
  if (!flat && D.gridded) add(svg, "rect", { x: b.left, y: b.top, width: b.width, height: b.height, fill: "var(--none)" });
  if (flat) add(svg, "path", { d: `M${b.left},${sy.place(D.threshold)}h${b.width}`, class: "gone", id: "threshold" });
  else layers(add(svg, "g", { "clip-path": "url(#inside)" }), sx, sy, b);
  frame(svg, sx, sy, b, axisText(state.x), flat ? "relative force drop" : axisText(state.y), told);
  const shown = D.points.filter(p => !p.mark && visible(p)), home = add(svg, "g", { id: "points", role: "group", "aria-label": "runs" });
  if (flat) add(home, "polyline", { points: shown.slice().sort((p, q) => p.at[state.x] - q.at[state.x]).filter(p => drop(p) !== null).map(p => sx.place(p.at[state.x]) + "," + yOf(p)).join(" "), class: "gone" });
  const size = Math.max(2.2, Math.min(5.2, 0.33 * Math.sqrt(b.width * b.height / Math.max(shown.length, 1))));
  for (const point of shown) dot(home, point, ...at(point), size);
  marks(home, sx, b);
  svg.setAttribute("aria-label", `${D.title}: ${axisText(state.x)} across, ${flat ? "force drop" : axisText(state.y)} up; ${counts(shown)}`);
  const here = walked();
  choose(here.includes(state.chosen) ? state.chosen : null);
  if (focused) focusOn(here.find(p => p.id === focused));
  legend(shown);
}
function axisText(k) { const a = D.axes[k]; return a.switch ? a.text : `${a.text} ${a.symbol}${a.unit ? " [" + a.unit + "]" : ""}`; }
function layers(svg, sx, sy, b) {
  const L = D.layers, on = layer => [layer.values[state.x].map(sx.place), layer.values[state.y].map(sy.place)];
  // Beyond the outermost runs what is known there holds to the frame.
  const wide = (z, xs, ys) => {
    const end = v => [v[0], ...v, v[v.length - 1]];
    return [end(z).map(end), [b.left, ...xs, b.left + b.width], [b.top + b.height, ...ys, b.top]];
  };
  if (state.shade === "drop") shade(svg, plane(L.drop, "z"), ...on(L.drop), b, v => drops(v / top()));
  if (state.shade === "chance") {
    const sd = plane(L.chance, "sd");
    shade(svg, plane(L.chance, "margin"), ...on(L.chance), b, (m, j, i) => drops(chance(m, sd[j][i])));
  }
  if (L.chance && (D.sought || state.shade === "chance")) {
    const sd = plane(L.chance, "sd"), doubt = plane(L.chance, "margin").map((row, j) => row.map((m, i) => m === null ? null : 1.96 * sd[j][i] - Math.abs(m)));
    const fill = pattern(svg, "doubt", "", 1, "#000");
    add(svg, "path", { d: region(...wide(doubt, ...on(L.chance))), fill, class: "doubt" });
  }
  const over = L.line ? plane(L.line, "z") : L.chance ? plane(L.chance, "margin").map(row => row.map(m => m === null ? null : Math.atanh(Math.max(-0.995, Math.min(0.995, m))))) : null;
  if (over) for (const s of D.strips) {
    const d = region(...wide(over, ...on(L.line || L.chance)), -s.high, -s.low);
    add(svg, "path", { d, class: "strip " + s.cause });
  }
  if (!D.sought && state.shade === "chance") {
    const half = contour(...wide(plane(L.chance, "margin"), ...on(L.chance)));
    add(svg, "path", { d: half, class: "boundary-halo" }); add(svg, "path", { d: half, class: "boundary even" });
  }
  if (L.classical) {
    const path = contour(...wide(plane(L.classical, "z"), ...on(L.classical)));
    add(svg, "path", { d: path, class: "boundary-halo thin" }); add(svg, "path", { d: path, class: "boundary classical" });
  }
  if (!L.line && !L.chance) return;
  const line = L.line ? contour(...wide(plane(L.line, "z"), ...on(L.line))) : contour(...wide(plane(L.chance, "margin"), ...on(L.chance)));
  add(svg, "path", { d: line, class: "boundary-halo" });
  add(svg, "path", { d: line, class: "boundary", id: "boundary" });
}
// Regimes differ by shape as well as by shade.
function sign(parent, label, x, y, r) {
  const draw = { abrupt: () => add(parent, "circle", { cx: x, cy: y, r, fill: "#000", stroke: "#fff", "stroke-width": 1.2 }),
    smooth: () => add(parent, "circle", { cx: x, cy: y, r, fill: "#fff", stroke: "#000", "stroke-width": 1.3 }),
    undecided: () => { add(parent, "circle", { cx: x, cy: y, r, fill: "#fff", stroke: "#000", "stroke-width": 1.3 }); add(parent, "path", { d: `M${x},${y - r}a${r},${r} 0 0 1 0,${2 * r}z` }); },
    "not cut": () => add(parent, "rect", { x: x - 1.1 * r, y: y - 0.45 * r, width: 2.2 * r, height: 0.9 * r, fill: "#000", stroke: "#fff", "stroke-width": 1 }),
    "to come": () => add(parent, "circle", { cx: x, cy: y, r: 0.5 * r, fill: "#777" }) }[label];
  if (draw) draw();
  else for (const look of [["#fff", 4.2], ["#b00", 2]]) add(parent, "path", { d: `M${x - r},${y - r}l${2 * r},${2 * r}m0,${-2 * r}l${-2 * r},${2 * r}`, stroke: look[0], "stroke-width": look[1] });
}
function dot(home, point, x, y, r) {
  const g = add(home, "g", { class: "point", role: "button", tabindex: -1, "data-id": point.id, "aria-label": spoken(point) });
  add(g, "circle", { cx: x, cy: y, r: r + 4, class: "halo" });
  if (point.mark) diamond(g, x, y, drop(point) === null ? "#fff" : drops(drop(point) / top()));
  else sign(g, labelOf(point), x, y, r);
  add(g, "circle", { cx: x, cy: y, r: r + 4, class: "ring" });
  g.addEventListener("focus", () => { if (!state.held) choose(point); });
  return g;
}
function diamond(parent, x, y, fill) {
  const d = `M${x},${y - 8}l8,8l-8,8l-8,-8z`;
  add(parent, "path", { d, fill: "none", stroke: "#fff", "stroke-width": 5 });
  add(parent, "path", { d, fill, stroke: "#d55e00", "stroke-width": 2.2 });
}
function spoken(point) {
  const at = D.axes.map((axis, k) => `${axis.label} ${axisValue(k, point.at[k])}`).join(", ");
  return `${point.mark ? point.mark + ", " : ""}${at}: ${labelOf(point)}${drop(point) === null ? "" : ", drop " + percent(drop(point))}`;
}
// Materials: a diamond each, in the colour of its own run's drop, with its name where there is room.
function marks(home, sx, b) {
  const placed = [];
  for (const mark of D.points.filter(p => p.mark && visible(p) && inside(p))) {
    const [x, y] = at(mark), right = x < b.left + 0.65 * b.width;
    const g = dot(home, mark, x, y, 5.5);
    let up = y - 10;
    while (placed.some(p => Math.abs(p[0] - x) < 90 && Math.abs(p[1] - up) < 14)) up += 15;
    placed.push([x, up]);
    add(g, "text", { x: x + (right ? 10 : -10), y: up, "text-anchor": right ? "start" : "end", class: "over" }, mark.mark + (mark.differs ? "*" : ""));
  }
}
function inside(point) {
  const [x, y] = at(point), b = view.b;
  return x >= b.left - 1 && x <= b.left + b.width + 1 && y >= b.top - 1 && y <= b.top + b.height + 1;
}
function counts(shown) {
  const found = {};
  for (const p of shown) found[labelOf(p)] = (found[labelOf(p)] || 0) + 1;
  return Object.entries(found).map(([name, n]) => `${n} ${name}`).join(", ");
}

// Which run is chosen: it is marked, and shown beside the map.
function choose(point) {
  const same = state.chosen === point;
  state.chosen = point;
  for (const g of document.querySelectorAll("#points .point")) {
    const mine = point !== null && g.dataset.id === point.id;
    g.classList.toggle("chosen", mine); g.classList.toggle("held", mine && state.held);
    g.setAttribute("tabindex", mine ? 0 : -1); g.setAttribute("aria-pressed", mine && state.held);
  }
  if (point === null) { const first = document.querySelector("#points .point"); if (first) first.setAttribute("tabindex", 0); }
  if (!same) detail(point);
}
function hold(point) { state.held = !(state.held && state.chosen === point); choose(point); }
function focusOn(point) { const g = point && document.querySelector(`#points [data-id="${point.id}"]`); if (g) g.focus(); }
function at(point) { return [view.sx.place(point.at[state.x]), view.yOf(point)]; }
// Runs and materials that can be chosen on the map as it is.
function walked() { return D.points.filter(p => visible(p) && inside(p)); }
function nearby(x, y, reach) {
  let best = null, least = reach;
  for (const p of walked()) { const q = at(p), d = Math.hypot(q[0] - x, q[1] - y); if (d < least) { best = p; least = d; } }
  return best;
}
// The next run in a direction: along it counts less than beside it.
function next(point, dx, dy) {
  const from = at(point);
  let best = null, least = Infinity;
  for (const p of walked()) {
    const q = at(p), u = q[0] - from[0], v = q[1] - from[1], along = u * dx + v * dy, cost = along + 3 * Math.abs(u * dy - v * dx);
    if (p !== point && along > 0.5 && cost < least) { best = p; least = cost; }
  }
  return best;
}
