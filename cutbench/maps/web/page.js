// A plane of the map and the chosen run, drawn by plotly; words and looks are in the data.
const D = JSON.parse(document.getElementById("data").textContent), by = id => document.getElementById(id);
const L = D.layers, LOOK = D.looks, map = by("map"), level = D.axes.map(axis => Math.floor(axis.levels.length / 2));
const state = { x: D.x, y: D.y, level, shade: L.drop ? "drop" : "none", chosen: null, held: false };
const others = () => D.gridded ? D.axes.map((_, k) => k).filter(k => k !== state.x && k !== state.y) : [];
const visible = p => others().every(k => nearest(D.axes[k].levels, p.at[k]) === state.level[k]);
const across = p => p.at[state.x], on = layer => ({ x: layer.values[state.x], y: layer.values[state.y] });
const up = p => state.y >= 0 ? p.at[state.y] : p.drop ?? (p.mark ? D.threshold : 0);
// Ratios count among positive values, and zero is a value like any.
function nearest(values, v) {
  const small = Math.min(...values.filter(u => u).map(Math.abs), Infinity);
  const away = u => small < Infinity ? Math.abs(Math.asinh(u / small) - Math.asinh(v / small)) : Math.abs(u - v);
  return values.reduce((best, u, i) => away(u) < away(values[best]) ? i : best, 0);
}
// A layer's numbers on the plane that is shown: rows of y, columns of x.
function plane(layer, key) {
  const stride = layer.values.map((_, k) => layer.values.slice(k + 1).reduce((size, v) => size * v.length, 1));
  const level = k => nearest(layer.values[k], D.axes[k].levels[state.level[k]]);
  const start = others().reduce((sum, k) => sum + level(k) * stride[k], 0);
  const at = (i, j) => (layer[key][start + i * stride[state.x] + j * stride[state.y]] ?? NaN) / 1000;
  return layer.values[state.y].map((_, j) => layer.values[state.x].map((_, i) => at(i, j)));
}
// The line on which z is 0, with a light edge; none where z does not change its sign.
function line(layer, z, name, look) {
  if (!z.some((row, j) => row.some((v, i) => v * row[i + 1] <= 0 || v * z[j + 1]?.[i] <= 0))) return [];
  const one = { ...LOOK.line, ...on(layer), z, name, line: look };
  return [{ ...one, showlegend: false, line: { color: "#fff", width: look.width + 2.5 } }, one];
}
// Whether the regime is not known with 95 % at the places of a plane, as part of an area wider than a cell.
function unsure(chances) {
  const open = (i, j) => chances[j]?.[i] > 0.025 && chances[j][i] < 0.975;
  const square = (i, j) => open(i, j) && open(i + 1, j) && open(i, j + 1) && open(i + 1, j + 1);
  return chances.map((row, j) => row.map((_, i) => square(i, j) || square(i - 1, j) || square(i, j - 1) || square(i - 1, j - 1)));
}
function layers() {  // all that lies behind the points
  const found = [], shade = L[state.shade], { chance, classical } = L, base = L.line ?? chance;
  if (shade) found.push({ zmax: D.top, ...LOOK.shades[state.shade], ...on(shade), z: plane(shade, shade.z ? "z" : "p"), colorscale: D.colours });
  if (!base) return found;
  const z = plane(base, "over"), doubt = chance && (D.sought || state.shade === "chance") ? unsure(plane(chance, "p")) : [];
  for (const strip of D.strips) {
    const contours = { type: "constraint", operation: "][", value: [-strip.high, -strip.low] };
    found.push({ ...LOOK.strip, ...on(base), z, contours, name: strip.text, fillcolor: LOOK.strips[strip.cause] });
  }
  const hatched = doubt.flatMap((row, j) => row.flatMap((is, i) => is ? [[on(chance).x[i], on(chance).y[j]]] : []));
  const marker = { ...LOOK.unsure.marker, size: Math.max(3, 0.8 * map.clientWidth / (doubt[0]?.length ?? 1)) };
  if (hatched.length) found.push({ ...LOOK.unsure, x: hatched.map(p => p[0]), y: hatched.map(p => p[1]), marker });
  if (L.line && doubt.length) found.push(...line(chance, plane(chance, "over"), "even chance", LOOK.lines.even));
  if (classical) found.push(...line(classical, plane(classical, "z"), "classical estimate", LOOK.lines.classical));
  // Where the regime is not known there is no firm line.
  const firm = D.sought ? z.map((row, j) => row.map((v, i) => doubt[j][i] ? NaN : v)) : z;
  if (D.sought && hatched.length) found.push(...line(base, z, `boundary, likeliest: ${D.line}`, LOOK.lines.likeliest));
  return [...found, ...line(base, firm, `boundary: ${D.line}`, LOOK.lines.firm)];
}
function runs(list, more) {
  const points = { x: list.map(across), y: list.map(up), customdata: list.map(p => p.id), text: list.map(p => p.text) };
  return list.length ? [{ ...LOOK.runs, ...points, ...more }] : [];
}
function draw() {
  for (const id of ["x", "y", "shade"]) if (by(id)) by(id).value = state[id];
  for (const label of document.querySelectorAll(".level")) {
    const k = Number(label.dataset.axis), [output, input] = label.children;
    label.hidden = !others().includes(k);
    input.value = state.level[k];
    output.textContent = input.ariaValueText = D.axes[k].texts[state.level[k]];
  }
  const flat = state.y < 0, shown = D.points.filter(visible), own = shown.filter(p => !p.mark), marks = shown.filter(p => p.mark);
  const path = own.filter(p => p.drop !== null).sort((p, q) => across(p) - across(q));
  const found = flat ? [{ ...LOOK.path, x: path.map(across), y: path.map(up) }] : D.gridded ? layers() : [];
  const size = Math.max(5, Math.min(10, 200 / Math.sqrt(own.length + 1)));
  for (const [kind, look] of Object.entries(LOOK.kinds)) {
    const list = own.filter(p => p.kind === kind), name = `${kind} (${list.length})`;
    found.push(...runs(list, { name, marker: { size, ...look } }));
  }
  const marker = { ...LOOK.material, color: marks.map(p => p.drop ?? 0), colorscale: D.colours, cmax: D.top };
  found.push(...runs(marks, { ...LOOK.materials, texttemplate: marks.map(p => `<b>${p.mark}</b>`), marker }), LOOK.ring);
  const axes = { xaxis: D.axes[state.x].layout, ...(flat ? {} : { yaxis: D.axes[state.y].layout }) };
  Plotly.react(map, found, { ...LOOK.map, ...axes, shapes: flat ? [{ ...LOOK.threshold, y0: D.threshold, y1: D.threshold }] : [] }, LOOK.config);
  map.ariaLabel = `${D.axes[state.x].label} across, ${flat ? "force drop" : D.axes[state.y].label} up, ${shown.length} runs`;
  choose(shown.includes(state.chosen) ? state.chosen : null);
}
function choose(p) {  // it is ringed, and shown beside the map
  Plotly.restyle(map, { x: [p ? [across(p)] : []], y: [p ? [up(p)] : []], "marker.line.width": state.held ? 6 : 4 }, [map.data.length - 1]);
  if (p && p === state.chosen) return;
  state.chosen = p;
  by("head").textContent = p ? p.head : "No run chosen";
  by("said").innerHTML = p ? p.notes : "Point at a run, tap it, or use the arrow keys.";
  by("numbers").tBodies[0].innerHTML = p ? p.rows : "";
  by("curve").hidden = !p?.curve;
  if (p?.curve) curve(p.curve, p.spots);
}
// Its force over travel and, below, what the force is made of: what takes it up above zero, what gives back below.
function curve(C, spots) {
  const N = values => values.map(v => v * C.scale), d = C.d.slice(0, C.mean.length), parts = Object.entries(C.split);
  const found = [{ ...LOOK.force, x: C.d, y: N(C.force) }, ...spots.map(([x, y, name]) => ({ ...LOOK[name], x: [x], y: [y] }))];
  for (const [legendgroup, share] of parts) {
    const { title: name, colour, shape } = D.entries[legendgroup], fillpattern = { shape, bgcolor: colour, fgcolor: "#fff", size: 7 };
    const area = { ...LOOK.share, x: d, legendgroup, name, fillcolor: colour, fillpattern };
    found.push({ ...area, stackgroup: "up", y: N(share.map(v => Math.max(v, 0))) });
    found.push({ ...area, stackgroup: "down", y: N(share.map(v => Math.min(v, 0))), showlegend: false });
  }
  found.push({ ...LOOK.mean, x: d, y: N(C.mean), name: `mean over ${C.window.toPrecision(2)} mm` });
  Plotly.react("curve", found, LOOK.curve, LOOK.config);
}
const place = p => [map._fullLayout.xaxis.d2p(across(p)), map._fullLayout.yaxis.d2p(up(p))];
const least = (list, cost) => list.reduce((a, b) => a && cost(a) <= cost(b) ? a : b, null);
function walk([dx, dy]) {  // to the next run in a direction: along it counts less than beside it
  const from = place(state.chosen), way = p => place(p).map((v, n) => v - from[n]);
  const ahead = D.points.filter(p => visible(p) && way(p)[0] * dx + way(p)[1] * dy > 0.5);
  const next = least(ahead, p => way(p)[0] * dx + way(p)[1] * dy + 3 * Math.abs(way(p)[0] * dy - way(p)[1] * dx));
  if (next) choose(next);
}
// The level above or below along the first axis that is not drawn, and there the nearest run.
function turn(step) {
  const k = others()[0], from = place(state.chosen);
  if (k === undefined || !(state.level[k] + step in D.axes[k].levels)) return;
  state.level[k] += step;
  draw();
  choose(least(D.points.filter(visible), p => Math.hypot(...place(p).map((v, n) => v - from[n]))));
}
const hold = p => { state.held = !(state.held && state.chosen === p); choose(p); };
draw();
const KEYS = {
  ArrowLeft: () => walk([-1, 0]), ArrowRight: () => walk([1, 0]), ArrowUp: () => walk([0, -1]), ArrowDown: () => walk([0, 1]),
  PageUp: () => turn(1), PageDown: () => turn(-1), Enter: () => hold(state.chosen),
};
const hit = event => D.points.find(p => event.points.some(q => q.customdata === p.id));
map.on("plotly_hover", event => { if (hit(event) && !state.held) choose(hit(event)); });
map.on("plotly_click", event => { if (hit(event)) hold(hit(event)); });
document.addEventListener("keydown", event => { if (event.key === "Escape" && state.held) hold(state.chosen); });
map.addEventListener("keydown", event => {
  if (!state.chosen || !(event.key in KEYS)) return;
  event.preventDefault();
  KEYS[event.key]();
});
for (const kind of ["input", "change"]) by("controls").addEventListener(kind, event => {
  const { id, value } = event.target, k = Number(value), axis = event.target.parentElement.dataset.axis;
  if (id === "shade") state.shade = value;
  else if (axis) state.level[axis] = k;
  else if (state[id === "x" ? "y" : "x"] === k) [state.x, state.y] = [state.y, state.x];
  else state[id] = k;
  draw();
});
by("marks")?.addEventListener("click", event => {
  const p = D.points.find(q => q.id === event.target.dataset.id);
  for (const k of p ? others() : []) state.level[k] = nearest(D.axes[k].levels, p.at[k]);
  draw();
  state.held = Boolean(p);
  choose(p ?? state.chosen);
});
choose(least(D.points.filter(p => !p.mark && visible(p) && p.drop !== null), p => Math.abs(p.drop - D.threshold))); // to begin with
