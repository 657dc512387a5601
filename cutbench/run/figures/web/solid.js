// Draws the block at one travel; all numbers come from Python.
const data = JSON.parse(document.getElementById("data").textContent);
const at = (name) => document.getElementById(name);
const plot = at("block"), travel = at("travel");
const rgb = (table, part) => table[Math.round(Math.min(Math.max(part, 0), 1) * (table.length - 1))];
const scale = (table) => table.map((colour, i) => [i / (table.length - 1), colour]);
const gradient = (table) => `linear-gradient(to right, ${table.join(",")})`;
at("stress").style.background = gradient(data.stressColours);
at("damage").style.background = gradient(data.damageColours);
at("offer").hidden = !data.symmetric;

const light = { ambient: data.light[0], diffuse: data.light[1], specular: 0, fresnel: 0 };
const columns = (rows, sign = 1) => ({
  x: rows.map((p) => sign * p[0]), y: rows.map((p) => p[1]), z: rows.map((p) => p[2]),
});
const corners = (rows) => ({ i: rows.map((t) => t[0]), j: rows.map((t) => t[1]), k: rows.map((t) => t[2]) });
const base = { type: "mesh3d", lighting: light, lightposition: { x: -20000, y: 30000, z: 20000 }, showscale: false, hoverinfo: "text" };

function lines(points, pairs, sign = 1) {
  const rows = pairs.flatMap(([a, b]) => [points[a], points[b], [null, null, null]]);
  const places = columns(rows, sign);
  places.x = places.x.map((x, i) => (rows[i][0] === null ? null : x));
  return { type: "scatter3d", mode: "lines", ...places, line: { color: "#000", width: 2 }, hoverinfo: "skip" };
}

function side(step, sign) {
  const places = columns(step.points, sign), mesh = data.meshes[step.mesh];
  const text = step.stress.map((kPa) => `${kPa} kPa`);
  const plane = step.stress.map((kPa) => rgb(data.stressColours, kPa / data.top));
  const said = [...text];
  mesh.cutNodes.forEach((node, k) => {
    said[node] = `damage ${step.damage[k]}, ${text[node]}`;
    if (step.damage[k] > data.seen) plane[node] = rgb(data.damageColours, step.damage[k]);
  });
  return [
    { ...base, ...places, ...corners(mesh.skin), intensity: step.stress, cmin: 0, cmax: data.top, colorscale: scale(data.stressColours), text },
    { ...base, ...places, ...corners(mesh.cut), vertexcolor: plane, text: said },
    lines(step.points, mesh.edges, sign),
  ];
}

function blade(step) {
  let points = step.blade;
  if (at("long").checked) {
    // The second half of the nodes lies where the blade is cut off; its own end is farther out.
    const far = points.slice(0, data.loop), near = points.slice(data.loop, 2 * data.loop), middles = points.slice(2 * data.loop);
    const out = (a, b) => b.map((value, i) => a[i] + (value - a[i]) / data.shown);
    points = [...far, ...near.map((p, i) => out(far[i], p)), middles[0], out(middles[0], middles[1])];
  }
  return [
    { ...base, ...columns(points), ...corners(data.blade), color: data.bladeColour, flatshading: true, hoverinfo: "skip" },
    lines(points, data.bladeEdges),
  ];
}

function draw() {
  const step = data.steps[travel.value];
  at("said").textContent = `${step.travel} mm`;
  const traces = side(step, 1);
  if (at("both").checked) traces.push(...side(step, -1));
  if (step.blade.length) traces.push(...blade(step));
  // Lifted off the cut plane, so that it does not half drown in it.
  for (const [color, width, lift] of [["#fff", 10, data.lift], ["#000", 5, 2 * data.lift]])
    traces.push({ type: "scatter3d", mode: "lines", ...columns(step.front.map(([x, y, z]) => [x - lift, y, z])), line: { color, width }, hoverinfo: "skip" });
  const ink = getComputedStyle(document.documentElement).getPropertyValue("--ink").trim();
  const axis = (title, range) => ({
    title: { text: title }, range, color: ink, showbackground: false, zeroline: false, nticks: 5, showgrid: false, showspikes: false,
  });
  const range = at("both").checked ? [[-data.range[0][1], data.range[0][1]], ...data.range.slice(1)] : data.range;
  const size = range.map(([low, high]) => high - low), narrow = plot.clientWidth < 520;
  const unit = Math.max(...size) / (data.zoom * (narrow ? 0.85 : 1)); // names of axes take more of a narrow page
  Plotly.react(plot, traces, {
    uirevision: "kept", showlegend: false, margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "rgba(0,0,0,0)", font: { color: ink, size: narrow ? 11 : 12 },
    scene: {
      aspectmode: "manual", aspectratio: { x: size[0] / unit, y: size[1] / unit, z: size[2] / unit },
      xaxis: axis("across (mm)", range[0]), yaxis: axis("height (mm)", range[1]), zaxis: axis("along the blade (mm)", range[2]),
      camera: { up: { x: 0, y: 1, z: 0 }, center: { x: 0, y: -0.1, z: 0 }, eye: { x: data.eye[0], y: data.eye[1], z: data.eye[2] }, projection: { type: "orthographic" } },
    },
  }, { responsive: true, displaylogo: false, modeBarButtons: [["toImage", "resetCameraDefault3d"]] });
}

for (const name of ["travel", "long", "both"]) at(name).addEventListener("input", draw);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
addEventListener("resize", draw);
draw();
