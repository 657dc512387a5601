// One run: its force over travel, what the force is made of, its numbers.
const INK = {};
D.entries.forEach((entry, n) => { INK[entry.name] = { n, colour: entry.name === "rest" || entry.name === "others" ? "#9a9a9a" : D.colours[n % D.colours.length], title: entry.title }; });

// What takes up force is stacked above zero, what gives it back below: at each point all of it is the mean force.
function stacked(split) {
  const bands = [];
  for (const take of [v => Math.max(v, 0), v => Math.min(v, 0)]) {
    let from = null;
    for (const name of Object.keys(split)) {
      const part = split[name].map(take), start = from || part.map(() => 0), to = start.map((v, i) => v + part[i]);
      if (part.some(v => v !== 0)) bands.push({ name, from: start, to });
      from = to;
    }
  }
  return bands;
}
function detail(point) {
  const svg = by("curve");
  svg.replaceChildren(); by("keys").replaceChildren(); by("curve-note").textContent = "";
  by("numbers").tBodies[0].replaceChildren();
  by("head").textContent = point ? (point.mark ? point.mark + ": " : "") + labelOf(point) + (drop(point) === null ? "" : `: the force falls by ${percent(drop(point))}`) : "No run chosen";
  by("said").replaceChildren();
  symbol(by("said"), point ? notes(point).join("; ") : "Point at a run, tap it, or use the arrow keys.");
  svg.toggleAttribute("hidden", !(point && point.curve));
  if (!point) return;
  if (point.curve) curves(svg, point);
  else if (point.outcome && point.outcome !== "missing") by("curve-note").textContent = "Its curve is not here: the page was written without the folder of the runs.";
  numbers(point);
}
function notes(point) {
  const found = point.differs ? ["not as on the map: " + point.differs] : [], crossed = measure(point, "crossed_mm"), drag = measure(point, "drag_steps");
  if (point.outcome && point.outcome !== "done") found.push(point.outcome === "missing" ? "not computed yet" : `${point.outcome}${point.reached === null ? "" : " at " + show(point.reached, "mm")}`);
  if (point.message) found.push(point.message);
  if (crossed !== null) found.push(`its surface passes through itself from ${show(crossed, "mm")} on`);
  if (drag) found.push(`${drag} points of the curve needed raised damping`);
  return found;
}
function curves(svg, point) {
  const C = point.curve, width = Math.max(290, by("right").clientWidth), parts = Object.keys(C.split).length > 0;
  const b = { left: 56, top: 8, width: width - 70, height: parts ? 170 : 240 }, low = { ...b, top: b.top + b.height + 14, height: 190 };
  const last = parts ? low : b, height = last.top + last.height + 46;
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`); svg.setAttribute("height", height);
  const N = v => v * C.scale, sx = scale(0, Math.max(...C.d) * 1.02, false, b.left, b.left + b.width);
  const F = C.force.map(N), sy = scale(1.08 * Math.min(0, ...F), 1.08 * Math.max(...F, 1e-12), false, b.top + b.height, b.top);
  const line = (y, values, to) => values.map((v, i) => sx.place(C.d[i]).toFixed(1) + "," + y.place(to(v)).toFixed(1)).join(" ");
  add(svg, "polyline", { points: line(sy, C.force, N), class: "force", id: "force" });
  spot(svg, sx, sy, measure(point, "onset_mm"), C, F, "onset");
  spot(svg, sx, sy, measure(point, "peak_mm"), C, F, "peak");
  frame(svg, sx, sy, b, parts ? null : "blade travel [mm]", "force [N]");
  svg.setAttribute("aria-label", `Force over blade travel, up to ${show(Math.max(...F), "N")}` + (parts ? "; below, the mean force by mechanism" : ""));
  let note = C.error ? `Thinned: the lines stay within ${percent(C.error)} of the largest force or share.` : "";
  if (parts) {
    const bands = stacked(C.split), all = bands.flatMap(band => band.to).map(N);
    const sp = scale(1.05 * Math.min(0, ...all), 1.05 * Math.max(...all, ...C.mean.map(N), 1e-12), false, low.top + low.height, low.top);
    bands.forEach(band => {
      const ink = INK[band.name], fill = pattern(svg, "p-" + band.name, ink.colour, ink.n, "var(--hatch)");
      const edge = values => values.map((v, i) => sx.place(C.d[i]).toFixed(1) + "," + sp.place(N(v)).toFixed(1));
      add(svg, "polygon", { points: edge(band.to).concat(edge(band.from).reverse()).join(" "), fill, class: "split", "data-name": band.name });
    });
    add(svg, "path", { d: `M${b.left},${sp.place(0)}h${b.width}`, class: "zero" });
    add(svg, "polyline", { points: line(sp, C.mean, N), class: "force", id: "mean" });
    frame(svg, sx, sp, low, "blade travel [mm]", "mean force [N]");
    for (const name of Object.keys(C.split)) {
      const key = make(by("keys"), "span"), small = add(key, "svg", { viewBox: "0 0 22 16", "aria-hidden": "true" });
      add(small, "rect", { width: 22, height: 16, fill: pattern(small, "k-" + name, INK[name].colour, INK[name].n, "var(--hatch)") });
      key.append(INK[name].title);
    }
    note = `Below: mean over ${show(C.window, "mm")} of travel, by mechanism, to the first rest of the blade; what gives force back stands below zero, and all of it is the line. ` + note;
  }
  by("curve-note").textContent = note;
  reader(svg, C, sx, b, last);
}
function spot(svg, sx, sy, mm, C, F, text) {
  if (mm === null || mm > Math.max(...C.d)) return;
  let i = C.d.findIndex(d => d >= mm);
  i = Math.max(1, i);
  const part = (mm - C.d[i - 1]) / (C.d[i] - C.d[i - 1] || 1), y = sy.place(F[i - 1] + part * (F[i] - F[i - 1])), x = sx.place(mm);
  if (text === "peak") add(svg, "path", { d: `M${x},${y - 1}l-5,-9h10z`, fill: "var(--accent)" });
  else add(svg, "circle", { cx: x, cy: y, r: 4.5, fill: "var(--paper)", stroke: "var(--ink)", "stroke-width": 1.6 });
}
// The force under the pointer.
function reader(svg, C, sx, b, last) {
  const rule = add(svg, "path", { class: "gone" }), text = add(svg, "text", { y: b.top + 16, class: "value" });
  svg.onpointermove = event => {
    const rect = svg.getBoundingClientRect(), x = (event.clientX - rect.left) * svg.viewBox.baseVal.width / rect.width;
    const d = sx.value(x), i = C.d.findIndex(v => v >= d);
    if (x < b.left || i < 1) return svg.onpointerleave();
    const part = (d - C.d[i - 1]) / (C.d[i] - C.d[i - 1] || 1), F = C.scale * (C.force[i - 1] + part * (C.force[i] - C.force[i - 1]));
    rule.setAttribute("d", `M${x},${b.top}V${last.top + last.height}`);
    const right = x < b.left + 0.6 * b.width;
    text.textContent = `${show(F, "N")} at ${show(d, "mm")}`;
    text.setAttribute("x", x + (right ? 6 : -6)); text.setAttribute("text-anchor", right ? "start" : "end");
  };
  svg.onpointerleave = () => { rule.setAttribute("d", ""); text.textContent = ""; };
}
function numbers(point) {
  const body = by("numbers").tBodies[0];
  const part = text => make(make(body, "tr", { class: "part" }), "th", { colspan: 3, scope: "rowgroup" }, text);
  const row = (name, sign, values, title) => {
    const line = make(body, "tr", title ? { title } : {}), head = make(line, "th", { scope: "row" }, name);
    if (sign) { head.append(" "); symbol(head, sign); }
    for (const value of values) { const cell = make(line, "td"); if (typeof value === "string") cell.append(value); else value(cell); }
  };
  let varied = 0;
  const found = D.quantities.map(q => ({ ...q, pair: q.fixed || point.values[varied++] || [null, null] }));
  const tell = q => cell => { symbol(cell, q.sets); cell.append(" = " + show(q.pair[1], q.in)); };
  part("Where it is");
  const onAxes = D.axes.map((axis, k) => {
    const q = found.find(q => q.name === axis.name);
    row(axis.label, axis.switch ? "" : axis.symbol, [axisValue(k, point.at[k]), ...(q && q.pair[1] !== null && q.symbol !== q.sets ? [tell(q)] : [])], axis.text);
    return q ? q.sets : axis.symbol;
  });
  for (const q of found)
    if (q.pair[0] !== null && !onAxes.includes(q.sets)) row(q.name === q.symbol ? q.text : words(q.name), q.symbol, [show(q.pair[0], q.unit), ...(q.symbol === q.sets ? [] : [tell(q)])], q.text);
  if (point.outcome) part("What was found");
  D.numbers.forEach((number, n) => {
    const value = point.measures[n];
    if (value !== null && !(number.noted && value === 0)) row(number.title, "", [show(value, number.unit)], number.text);
  });
  if (point.closure !== null) row("closure", "", [percent(point.closure)], "what the energy balance does not account for, relative to the work of the blade");
  if (point.reached !== null) row("reached", "", [show(point.reached, "mm")], "blade travel reached");
  if (point.outcome) row("run", "", [point.id], "its folder in the store");
}
