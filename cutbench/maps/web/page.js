// Controls, keys, pointer, legend, table; and the first picture.
function controls() {
  const home = by("controls");
  home.replaceChildren();
  const pick = (id, text, entries, chosen, take) => {
    const label = make(home, "label", {}, text), select = make(label, "select", { id });
    for (const [value, name] of entries) make(select, "option", { value, ...(value === String(chosen) ? { selected: "" } : {}) }, name);
    select.addEventListener("change", () => take(select.value));
  };
  const axes = D.axes.map((axis, k) => [String(k), axis.label]);
  const swap = (which, k) => {
    const other = which === "x" ? "y" : "x";
    if (state[other] === k) state[other] = state[which];
    state[which] = k;
    controls(); draw(); by(which).focus();
  };
  if (state.y >= 0 && axes.length > 1) for (const [which, text] of [["x", "across"], ["y", "up"]]) pick(which, text, axes, state[which], v => swap(which, Number(v)));
  if (state.y >= 0 && D.layers.drop) {
    const shades = [["drop", "force drop"], ...(D.layers.chance ? [["chance", "chance of abrupt"]] : []), ["none", "nothing"]];
    pick("shade", "shading", shades, state.shade, v => { state.shade = v; draw(); });
  }
  for (const k of others()) {
    const axis = D.axes[k], values = levels(k), name = axis.label;
    if (state.level[k] === undefined || state.level[k] >= values.length) state.level[k] = Math.floor(values.length / 2);
    const go = n => { state.level[k] = n; draw(); };
    if (values.length === 1) make(make(home, "span", {}, name + " "), "output", { id: "level-" + axis.name }, axisValue(k, values[0]));
    else if (values.length > 6) {
      const label = make(home, "label", {}, name), slider = make(label, "input", { type: "range", min: 0, max: values.length - 1, step: 1, id: "level-" + axis.name });
      const out = make(label, "output"), tell = () => { out.textContent = axisValue(k, values[state.level[k]]); slider.setAttribute("aria-valuetext", out.textContent); };
      slider.value = String(state.level[k]); tell();
      slider.addEventListener("input", () => { go(Number(slider.value)); tell(); });
    } else {
      const set = make(home, "fieldset", { id: "level-" + axis.name, role: "radiogroup" });
      make(set, "legend", {}, name);
      values.forEach((v, n) => {
        const tab = make(set, "label", { class: "tab" }), input = make(tab, "input", { type: "radio", name: "level-" + axis.name, value: n });
        input.checked = n === state.level[k]; tab.append(axisValue(k, v));
        input.addEventListener("change", () => go(n));
      });
    }
  }
}
function legend(shown) {
  const home = by("legend"), width = 420;
  home.replaceChildren();
  // On grey: signs are black and white, in the dark too.
  const key = (draw, text) => { const span = make(home, "span"); draw(add(span, "svg", { viewBox: "0 0 22 16", "aria-hidden": "true", class: "sign" })); span.append(text); };
  for (const name of ["abrupt", "smooth", "undecided", "not cut", "not computed", "to come"]) {
    const n = shown.filter(p => labelOf(p) === name).length;
    if (n) key(svg => sign(svg, name, 11, 8, 5.2), `${name} (${n})`);
  }
  if (by("boundary") && by("boundary").getAttribute("d")) key(svg => { add(svg, "path", { d: "M0,8h22", class: "boundary-halo" }); add(svg, "path", { d: "M0,8h22", class: "boundary" }); }, `boundary: drop of ${percent(D.threshold)}${D.surge === null ? "" : ", surge of " + show(D.surge)}`);
  for (const [name, text] of [["even", "even chance"], ["classical", "classical estimate"]]) {
    const line = document.querySelector("#map ." + name);
    if (line && line.getAttribute("d")) key(svg => { add(svg, "path", { d: "M0,8h22", class: "boundary-halo" }); add(svg, "path", { d: "M0,8h22", class: "boundary " + name }); }, text);
  }
  if (by("threshold")) key(svg => add(svg, "path", { d: "M0,8h22", class: "gone" }), `drop of ${percent(D.threshold)}`);
  const doubt = document.querySelector("#map .doubt");
  if (doubt && doubt.getAttribute("d")) key(svg => add(svg, "rect", { width: 22, height: 16, fill: pattern(svg, "key-doubt", "#ddd", 1, "#000") }), "regime not known with 95 %, from the runs alone");
  for (const s of D.strips) {
    const strip = document.querySelector("#map .strip." + s.cause);
    if (strip && strip.getAttribute("d")) key(svg => { add(svg, "rect", { width: 22, height: 16, fill: "#777" }); for (const t of D.strips.slice(0, D.strips.indexOf(s) + 1)) add(svg, "rect", { width: 22, height: 16, class: "strip " + t.cause }); }, s.text);
  }
  const named = D.points.filter(p => p.mark && visible(p) && inside(p));
  if (named.length) key(svg => diamond(svg, 11, 8, "#fff"), (named.some(p => p.outcome) ? "material, in the colour of its own run" : "material") + (named.some(p => p.differs) ? " (*: not as on the map)" : ""));
  const bar = by("scale");
  bar.replaceChildren();
  if (state.y < 0 || state.shade === "none" || !D.layers[state.shade]) return;
  const svg = add(bar, "svg", { viewBox: `0 0 ${width} 46`, role: "img", "aria-label": "scale of the shading" });
  const last = state.shade === "drop" ? top() : 1, s = scale(0, last, false, 8, width - 8), ramp = add(add(svg, "defs", {}), "linearGradient", { id: "ramp" });
  for (let n = 0; n <= 16; n++) add(ramp, "stop", { offset: n / 16, "stop-color": drops(n / 16) });
  add(svg, "rect", { x: 8, y: 2, width: width - 16, height: 12, fill: "url(#ramp)", class: "rule", style: "fill: url(#ramp)" });
  for (const t of s.ticks) add(svg, "text", { x: s.place(t), y: 27, "text-anchor": t ? (t === last ? "end" : "middle") : "start" }, state.shade === "drop" ? show(t) : percent(t));
  if (state.shade === "drop") add(svg, "path", { d: `M${s.place(D.threshold)},0v16`, stroke: "#000", "stroke-width": 2.5 });
  add(svg, "text", { x: width / 2, y: 43, "text-anchor": "middle" }, state.shade === "drop" ? "relative force drop" : "chance that cutting is abrupt there, from the runs alone");
}
// What is known where the pointer is, between the runs.
function place(x, y) {
  const { b, sx, sy } = view;
  if (state.y < 0 || !D.gridded || x < b.left || x > b.left + b.width || y < b.top || y > b.top + b.height) { by("place").textContent = "\u00a0"; return; }
  const here = { [state.x]: sx.value(x), [state.y]: sy.value(y) };
  const pick = (layer, key) => plane(layer, key)[nearest(layer.values[state.y], here[state.y])][nearest(layer.values[state.x], here[state.x])];
  let text = [state.x, state.y].map(k => `${D.axes[k].label} ${show(here[k], D.axes[k].unit)}`).join(", ");
  const d = D.layers.drop ? pick(D.layers.drop, "z") : null;
  if (d !== null) text += `: drop about ${percent(d)}`;
  if (D.layers.chance && pick(D.layers.chance, "margin") !== null) text += `, abrupt with a chance of ${percent(chance(pick(D.layers.chance, "margin"), pick(D.layers.chance, "sd")))}`;
  by("place").textContent = text;
}
function pointer() {
  const svg = by("map"), spot = event => {
    const rect = svg.getBoundingClientRect(), zoom = svg.viewBox.baseVal.width / rect.width;
    return [(event.clientX - rect.left) * zoom, (event.clientY - rect.top) * zoom];
  };
  svg.addEventListener("pointermove", event => {
    if (event.pointerType === "touch") return;
    const p = spot(event), point = nearby(...p, 16);
    place(...p);
    if (point && !state.held) choose(point);
  });
  svg.addEventListener("pointerleave", () => { by("place").textContent = "\u00a0"; });
  svg.addEventListener("click", event => {
    const p = spot(event), point = event.detail === 0 ? state.chosen : nearby(...p, 26);
    place(...p);
    if (point) { hold(point); focusOn(point); }
  });
  svg.addEventListener("keydown", event => {
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const own = event.target.closest(".point"), here = own && D.points.find(p => p.id === own.dataset.id);
    if (!here) return;
    if (event.key === "PageUp" || event.key === "PageDown") turn(here, event.key === "PageUp" ? 1 : -1);
    else if (way) { const there = next(here, ...way); if (there) { choose(there); focusOn(there); } }
    else if (event.key === "Enter" || event.key === " ") hold(here);
    else return;
    event.preventDefault();
  });
  document.addEventListener("keydown", event => { if (event.key === "Escape") { state.held = false; choose(state.chosen); } });
}
// The level above or below along the first axis that is not drawn, and there the run nearest to this one.
function turn(point, by) {
  const k = others()[0], n = state.level[k] + by, [x, y] = at(point);
  if (k === undefined || n < 0 || n >= levels(k).length) return;
  state.level[k] = n;
  controls(); draw();
  const there = nearby(x, y, Infinity);
  if (there) { choose(there); focusOn(there); }
}
function table() {
  const home = by("table"), marked = D.points.some(p => p.mark);
  if (home.rows.length) return;
  const head = make(make(home, "thead"), "tr"), names = D.axes.map(a => a.label + (a.unit ? ` [${a.unit}]` : ""));
  const numbers = D.numbers.map(m => m.title + (m.unit === "1" ? "" : ` [${m.unit}]`));
  for (const name of [...(marked ? ["material"] : []), ...names, "regime", ...numbers, "reached [mm]", "end", "run"]) make(head, "th", { scope: "col" }, name);
  const body = make(home, "tbody");
  for (const p of D.points.filter(p => p.outcome)) {
    const row = make(body, "tr"), cells = [...(marked ? [p.mark] : []), ...p.at.map((v, k) => axisValue(k, v)), labelOf(p), ...p.measures.map(v => show(v)), show(p.reached), p.outcome, p.id];
    for (const cell of cells) make(row, "td", {}, cell);
  }
}
function materials() {
  const list = by("marks").querySelector("ul"), marked = D.points.filter(p => p.mark);
  for (const point of marked) {
    const line = make(list, "li"), button = make(line, "button", { type: "button" }, point.mark);
    const told = [D.axes.map((axis, k) => `${axis.label} ${axisValue(k, point.at[k])}`).join(", "), labelOf(point) + (drop(point) === null ? "" : `, drop ${percent(drop(point))}`)];
    if (point.at.some((v, k) => v < Math.min(...D.axes[k].values) * (1 - 1e-3) || v > Math.max(...D.axes[k].values) * (1 + 1e-3))) told.unshift("outside the map");
    symbol(make(line, "span"), ` ${told.join("; ")}${point.differs ? "; not as on the map: " + point.differs : ""}`);
    button.addEventListener("click", () => {
      for (const k of others()) state.level[k] = nearest(levels(k), point.at[k]);
      controls(); draw();
      state.held = true; choose(point);
    });
  }
  by("marks").toggleAttribute("hidden", !marked.length);
}
if (D.by.length) { by("by").textContent = D.by.join(" "); by("by").hidden = false; }
controls();
draw();
pointer();
materials();
by("all").addEventListener("toggle", table);
// To begin with, the run nearest the threshold.
const first = D.points.filter(p => !p.mark && visible(p) && drop(p) !== null);
choose(first.length ? first.reduce((a, b) => Math.abs(drop(b) - D.threshold) < Math.abs(drop(a) - D.threshold) ? b : a) : null);
if (!state.chosen) detail(null);
let wide = window.innerWidth;
window.addEventListener("resize", () => {
  if (wide === window.innerWidth) return;
  wide = window.innerWidth;
  const chosen = state.chosen;
  draw(); state.chosen = null; choose(chosen);
});
