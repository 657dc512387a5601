// The page: sliders to a case, a job to its pictures, readings to a fit. All physics is the server's.
const $ = id => document.getElementById(id);
const KEPT = 4;  // earlier curves that stay in the picture
const TITLES = { onset_mm: "onset (mm)", peak_N: "peak (N)", peak_mm: "peak at (mm)", drop_rel: "fall of the force (part)", steady_N: "steady force (N)", energy_mJ: "work (mJ)", closure: "energy left open (part)" };
let known, curves = [], section = null, cells = [], top_kPa = 1e-3, job = null, held = [];

async function ask(path, body, method = "POST") {
  const given = body === undefined ? {} : { method, body: body instanceof Blob ? body : JSON.stringify(body) };
  const answer = await fetch(path, given);
  const said = await answer.json().catch(() => ({ error: `the server answered ${answer.status}` }));
  if (!answer.ok) throw Object.assign(new Error(said.error), { key: said.key });
  return said;
}

function element(name, attributes = {}, ...inside) {
  const made = Object.assign(document.createElement(name), attributes);
  made.append(...inside);
  return made;
}

// -- what is asked ----------------------------------------------------------------------------------
const round = v => Number(Number(v).toPrecision(4));
const along = (s, v) => s.log ? Math.log(v / s.low) / Math.log(s.high / s.low) : (v - s.low) / (s.high - s.low);
const value = (s, t) => round(s.log ? s.low * (s.high / s.low) ** t : s.low + t * (s.high - s.low));

function sliders() {
  const material = known.materials.find(m => m.name === $("material").value), parts = {};
  for (const s of material.tools[$("tool").value]) (parts[s.section] ??= []).push(s);
  const first = new Set(["G", "G_c", "eta_reg", "thickness", "tip", "angle", "speed", "depth", "height"]);
  $("sliders").replaceChildren(...["parameters", "blade", "specimen", "protocol"].filter(k => parts[k]).map(key => {
    const name = { parameters: "Material", blade: "Blade", specimen: "Specimen", protocol: "Test" }[key];
    const row = s => {
      const range = element("input", { type: "range", min: 0, max: 1, step: "any", value: along(s, s.value), ariaLabel: s.doc });
      const box = element("input", { type: "text", inputMode: "decimal", value: s.value, id: `value-${s.name}`, size: 7, ariaLabel: s.name });
      range.oninput = () => { box.value = value(s, Number(range.value)); changed(); };
      box.oninput = () => { range.value = along(s, Number(box.value)); changed(); };
      const made = element("div", { className: "slider" }, element("span", { title: s.doc }, element("i", { textContent: s.symbol }), ` ${s.doc}`), range, box, element("span", { className: "unit", textContent: s.unit }));
      made.asked = { ...s, box };
      return made;
    };
    const seen = parts[key].filter(s => first.has(s.name)), rest = parts[key].filter(s => !first.has(s.name));
    const more = rest.length ? [element("details", {}, element("summary", { textContent: `more of ${name.toLowerCase()}` }), ...rest.map(row))] : [];
    return element("details", { open: true }, element("summary", { textContent: name }), ...seen.map(row), ...more);
  }));
  changed();
}

function wanted() {
  const values = {};
  for (const row of document.querySelectorAll(".slider")) {
    const { name, unit, value, box } = row.asked;
    if (Number(box.value) !== value) values[name] = unit ? `${box.value} ${unit}` : box.value;
  }
  return { material: $("material").value, tool: $("tool").value, values, numerics: $("numerics").value, until: $("until").value };
}

let waiting, asking = 0;
function changed() {
  clearTimeout(waiting);
  waiting = setTimeout(check, 150);
}
async function check() {
  const mine = ++asking;
  let found = { groups: [], doubts: [] }, fault = null;
  try { found = await ask("api/check", wanted()); } catch (error) { fault = error; }
  if (mine !== asking) return;
  $("fault").textContent = fault ? fault.message : "";
  $("start").disabled = Boolean(fault);
  for (const row of document.querySelectorAll(".slider")) row.classList.toggle("wrong", Boolean(fault) && fault.key === row.asked.name);
  $("doubts").replaceChildren(...found.doubts.map(text => element("li", { textContent: text })));
  $("groups").replaceChildren(...found.groups.map(g => element("tr", {}, element("th", { textContent: g.name, scope: "row" }), element("td", { textContent: g.value }))));
}

// -- a run ------------------------------------------------------------------------------------------
const redraw = () => { drawCurves($("curve"), curves); drawSection($("section"), section, cells, top_kPa); };

function listen(id, on, end) {
  const source = new EventSource(`api/jobs/${id}/events`);
  source.onmessage = message => {
    const told = JSON.parse(message.data);
    on(told);
    if (told.state) { source.close(); end(told); }
  };
}

async function start(event) {
  event.preventDefault();
  try { job = await ask("api/runs", wanted()); } catch (error) { $("fault").textContent = error.message; return; }
  curves = [...curves.map(c => ({ ...c, old: true })), { mm: [0], N: [0] }].slice(-KEPT - 1);
  [section, cells, top_kPa] = [null, [], 1e-3];
  const curve = curves.at(-1), name = $("material").value;
  $("start").disabled = true; $("stop").disabled = false; $("part").hidden = false; $("part").removeAttribute("value");
  $("said").textContent = `${name}: running`; $("measures").replaceChildren(); $("files").replaceChildren();
  if (innerWidth <= 820) $("said").scrollIntoView();
  let frame = 0;
  listen(job.id, told => {
    if (told.part !== undefined) { $("part").value = told.part; $("said").textContent = `${name}: ${told.text}`; }
    if (told.point) { curve.mm.push(told.point.mm); curve.N.push(told.point.N); }
    if (told.section) {
      section = told.section; cells = section.cells ?? cells;
      top_kPa = Math.max(top_kPa, section.top_kPa);
      $("stress").textContent = `Section at ${section.mm.toFixed(2)} mm, von Mises stress`;
    }
    if (told.error) { $("fault").textContent = told.error; $("said").textContent = `${name}: not computed`; }
    if (told.said) outcome(told, name);
    if (!frame) frame = requestAnimationFrame(() => { frame = 0; redraw(); });
  }, told => {
    $("start").disabled = false; $("stop").disabled = true; $("part").hidden = true;
    if (told.state === "stopped") $("said").textContent = `${name}: stopped`;
    redraw();
  });
}

function outcome(told, name) {
  $("said").textContent = `${name}: ${told.said}`;
  $("measures").replaceChildren(...Object.entries(TITLES).filter(([key]) => key in told.measures).map(([key, title]) => element("tr", {}, element("th", { textContent: title, scope: "row" }), element("td", { textContent: round(told.measures[key]) }))));
  links($("files"), job.folder, told.files);
}

function links(into, folder, names) {
  into.replaceChildren(...names.flatMap((name, k) => [k ? " · " : "", element("a", { href: `files/${folder}/${encodeURIComponent(name)}`, target: "_blank", textContent: name })]));
}

// -- readings ---------------------------------------------------------------------------------------
const ROLES = { cut: ["displacement", "force", "time"], uniaxial: ["displacement", "force", "time"], pure_shear: ["displacement", "force", "time"], equibiaxial: ["stretch", "stress", "time"] };
const UNITS = { displacement: "mm", force: "N", time: "s", stretch: "1", stress: "MPa" };
const LIKE = { displacement: /dis|trav|ext|way|elong|position|^u\b/i, force: /force|load|kraft|^f\b/i, time: /time|zeit|^t\b/i, stretch: /stretch/i, stress: /stress/i };
const SIZES = { cut: { specimen: { width: "30 mm", length: "30 mm", height: "21 mm" }, blade: { thickness: "0.7 mm", tip: "1.05 mm" } }, uniaxial: { specimen: { length: "", area: "" } }, pure_shear: { specimen: { length: "", area: "" } }, equibiaxial: {} };

function heads(lines) {
  for (const line of lines) {
    const cells = line.split(/[;\t|,]/).map(c => c.trim().replace(/^"|"$/g, ""));
    if (cells.length > 1 && cells.filter(c => /[a-z]/i.test(c)).length >= 2) return cells;
  }
  return [];
}

function fields() {
  const kind = $("kind").value, names = heads(held[0]?.head ?? []);
  const field = (id, label, text, hint = "") => element("label", {}, label, element("input", { id, value: text, placeholder: hint, size: 11 }));
  $("columns").replaceChildren($("columns").firstElementChild, ...ROLES[kind].flatMap(role => {
    const found = names.find(n => LIKE[role].test(n)) ?? "";
    return [field(`column-${role}`, role, found, "none"), field(`unit-${role}`, "in", "", `as written, or ${UNITS[role]}`)];
  }));
  $("sizes").replaceChildren($("sizes").firstElementChild, ...Object.entries(SIZES[kind]).flatMap(([part, sizes]) => Object.entries(sizes).map(([name, text]) => field(`${part}-${name}`, part === "blade" ? `blade ${name}` : name, text, "with unit"))));
}

async function keep(files) {
  $("data-fault").textContent = "";
  for (const file of files) {
    try { held = [...held.filter(h => h.name !== file.name), await ask(`api/files/${encodeURIComponent(file.name)}`, file, "PUT")]; }
    catch (error) { $("data-fault").textContent = error.message; }
  }
  $("kept").replaceChildren(...held.map(h => element("li", { textContent: h.name })));
  $("head").hidden = !held.length;
  $("head").textContent = held[0]?.head.join("\n") ?? "";
  fields();
}

const filled = (prefix, names) => Object.fromEntries(names.map(n => [n, $(`${prefix}-${n}`)?.value.trim() ?? ""]).filter(([, v]) => v));

async function analyse(event) {
  event.preventDefault();
  const kind = $("kind").value, task = event.submitter.value, sizes = SIZES[kind];
  const body = { task, files: held.map(h => h.name), kind, material: $("like").value, columns: filled("column", ROLES[kind]), units: filled("unit", ROLES[kind]), speed: $("speed").value.trim(), zero: $("zero").value, force_zero: $("force_zero").value };
  for (const part of Object.keys(sizes)) body[part] = filled(part, Object.keys(sizes[part]));
  for (const key of ["units", "speed", "specimen", "blade", "zero", "force_zero"]) if (!body[key] || !Object.keys(body[key]).length) delete body[key];
  $("data-fault").textContent = ""; $("found").hidden = $("data-page").hidden = true; $("data-files").replaceChildren();
  let mine;
  try { mine = await ask("api/campaigns", body); } catch (error) { $("data-fault").textContent = error.message; return; }
  const buttons = document.querySelectorAll("#readings .main");
  buttons.forEach(b => b.disabled = true);
  $("stop-data").disabled = false; $("stop-data").onclick = () => ask(`api/jobs/${mine.id}/stop`, {});
  $("data-part").hidden = false; $("data-part").removeAttribute("value"); $("data-text").textContent = "under way";
  listen(mine.id, told => {
    if (told.part !== undefined) $("data-part").value = told.part;
    if (told.text) $("data-text").textContent = told.text;
    if (told.error) $("data-fault").textContent = told.error;
    if (told.said) {
      $("found").hidden = false; $("found").textContent = told.said; links($("data-files"), mine.folder, told.files);
      const shown = told.files.find(n => n.endsWith(".html")) ?? told.files.find(n => n.endsWith(".png"));
      if (shown) { $("data-page").hidden = false; $("data-page").src = `files/${mine.folder}/${shown}`; }
    }
  }, told => {
    buttons.forEach(b => b.disabled = false); $("stop-data").disabled = true; $("data-part").hidden = true;
    $("data-text").textContent = told.state === "done" ? "" : told.state;
  });
}

// -- maps, tabs, beginning ----------------------------------------------------------------------------
async function maps() {
  known.maps = (await ask("api/begin")).maps;
  const none = !known.maps.length;
  $("no-maps").hidden = !none; $("which").hidden = $("map-page").hidden = none;
  if (none) return;
  const before = $("map").value;
  $("map").replaceChildren(...known.maps.map(path => element("option", { value: path, textContent: path })));
  if (known.maps.includes(before)) $("map").value = before; else open_map();
}
const open_map = () => { $("map-page").src = `files/${$("map").value.split("/").map(encodeURIComponent).join("/")}`; };

function tab(chosen) {
  for (const each of document.querySelectorAll("[role=tab]")) {
    const is = each === chosen;
    each.setAttribute("aria-selected", is); each.tabIndex = is ? 0 : -1;
    $(each.getAttribute("aria-controls")).hidden = !is;
  }
  chosen.focus();
  if (chosen.id === "tab-maps") maps();
  redraw();
}

async function begin() {
  known = await ask("api/begin");
  const options = (list, text = x => x) => list.map(x => element("option", { value: x, textContent: text(x) }));
  for (const id of ["material", "like"]) { $(id).replaceChildren(...options(known.materials.map(m => m.name))); $(id).value = "gelatin"; }
  const blades = () => {
    const before = $("tool").value, there = Object.keys(known.tools).filter(t => t in known.materials.find(m => m.name === $("material").value).tools);
    $("tool").replaceChildren(...options(there, t => known.tools[t]));
    if (there.includes(before)) $("tool").value = before;
    sliders();
  };
  $("numerics").replaceChildren(...options(known.numerics));
  if (known.numerics.includes("fast")) $("numerics").value = "fast";
  $("material").onchange = blades; $("tool").onchange = sliders; $("reset").onclick = sliders;
  $("numerics").onchange = $("until").onchange = changed;
  $("choices").onsubmit = start; $("stop").onclick = () => ask(`api/jobs/${job.id}/stop`, {});
  $("kind").onchange = fields; $("readings").onsubmit = analyse; $("file").onchange = () => keep($("file").files);
  $("drop").ondragover = event => { event.preventDefault(); $("drop").classList.add("over"); };
  $("drop").ondragleave = () => $("drop").classList.remove("over");
  $("drop").ondrop = event => { event.preventDefault(); $("drop").classList.remove("over"); keep(event.dataTransfer.files); };
  $("map").onchange = open_map;
  const all = [...document.querySelectorAll("[role=tab]")];
  all.forEach((each, k) => {
    each.onclick = () => tab(each);
    each.onkeydown = event => { const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key]; if (by) tab(all[(k + by + all.length) % all.length]); };
  });
  window.onresize = redraw;
  matchMedia("(prefers-color-scheme: dark)").onchange = redraw;
  blades(); fields(); redraw();
}
begin();
