"use strict";
// The pictures: a curve and a section on canvases, in the page's own colours.
const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
// Viridis, in nine stops.
const STRESS = [[68,1,84],[71,44,122],[59,81,139],[44,113,142],[33,144,141],[39,173,129],[92,200,99],[170,220,50],[253,231,37]];

function sheet(canvas) {
  const ratio = window.devicePixelRatio || 1, box = canvas.getBoundingClientRect();
  canvas.width = Math.max(1, Math.round(box.width * ratio));
  canvas.height = Math.max(1, Math.round(box.height * ratio));
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, box.width, box.height);
  pen.font = "12.5px Arial, Helvetica, sans-serif";
  return { pen, width: box.width, height: box.height };
}

// Round numbers from 0 to at least `end`.
function ticks(end) {
  const rough = end / 5, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 2.5, 5, 10].map(k => k * power).find(s => s >= rough);
  return Array.from({ length: Math.floor(end / step + 1e-9) + 1 }, (_, k) => Number((k * step).toPrecision(12)));
}

// Curves [{mm: [], N: [], old}]: earlier ones faint, the last one strong.
function drawCurves(canvas, curves) {
  const { pen, width, height } = sheet(canvas), left = 58, right = 12, top = 10, bottom = 40;
  const most = (name, least) => Math.max(least, ...curves.flatMap(c => c[name]));
  const farthest = most("mm", 0.1), largest = 1.06 * most("N", 1e-6);
  const x = mm => left + (width - left - right) * mm / farthest, y = N => height - bottom - (height - top - bottom) * N / largest;
  pen.strokeStyle = css("--rule"); pen.fillStyle = css("--ink"); pen.lineWidth = 1;
  pen.textAlign = "center"; pen.textBaseline = "top";
  for (const t of ticks(farthest)) { pen.beginPath(); pen.moveTo(x(t), y(0)); pen.lineTo(x(t), y(0) + 5); pen.stroke(); pen.fillText(t, x(t), y(0) + 8); }
  pen.textAlign = "right"; pen.textBaseline = "middle";
  for (const t of ticks(largest)) { pen.beginPath(); pen.moveTo(left - 5, y(t)); pen.lineTo(left, y(t)); pen.stroke(); pen.fillText(t, left - 8, y(t)); }
  pen.beginPath(); pen.moveTo(left, top); pen.lineTo(left, y(0)); pen.lineTo(width - right, y(0)); pen.stroke();
  pen.textAlign = "center"; pen.textBaseline = "bottom";
  pen.fillText("blade travel (mm)", (left + width - right) / 2, height - 1);
  pen.save(); pen.translate(12, (top + y(0)) / 2); pen.rotate(-Math.PI / 2); pen.fillText("force (N)", 0, 4); pen.restore();
  for (const c of curves) {
    pen.strokeStyle = c.old ? css("--soft") : css("--accent");
    pen.globalAlpha = c.old ? 0.5 : 1; pen.lineWidth = c.old ? 1.2 : 2.2;
    pen.setLineDash(c.old ? [5, 4] : []);
    pen.beginPath(); c.mm.forEach((mm, k) => pen.lineTo(x(mm), y(c.N[k]))); pen.stroke();
  }
  pen.globalAlpha = 1; pen.setLineDash([]);
}

function shade(part) {
  const at = Math.min(0.9999, Math.max(0, part)) * (STRESS.length - 1), k = Math.floor(at), f = at - k;
  return `rgb(${STRESS[k].map((c, i) => Math.round(c + f * (STRESS[k + 1][i] - c)))})`;
}

// The section, whole and about the tip: triangles in the colour of their stress, mirrored where half is computed.
function drawSection(canvas, s, cells, top) {
  const { pen, width, height } = sheet(canvas);
  if (!s) return;
  const roof = Math.max(s.height, ...s.y) + 0.06 * s.height, tip = Math.min(...s.blade.map(p => p[1]));
  const split = 0.56 * (width - 64);
  view(pen, s, cells, top, [0, split - 10], height, 0, roof / 2, Math.min((split - 10) / (1.04 * s.width), height / (1.04 * roof)));
  view(pen, s, cells, top, [split, width - 64], height, 0, tip, Math.min(width - 64 - split, height) / (2 * s.near));
  // The colours' scale.
  const from = 0.15 * height, to = 0.85 * height;
  for (let k = 0; k < 60; k++) { pen.fillStyle = shade(1 - k / 59); pen.fillRect(width - 54, from + (to - from) * k / 60, 14, (to - from) / 60 + 1); }
  pen.fillStyle = css("--ink"); pen.textAlign = "left"; pen.textBaseline = "middle";
  pen.fillText(Number(top.toPrecision(2)), width - 36, from); pen.fillText("0", width - 36, to);
  pen.fillText("kPa", width - 36, (from + to) / 2);
}

// One view between the pixels `from` and `to`, the point (cx, cy) mm in its middle, `scale` pixels a mm.
function view(pen, s, cells, top, [from, to], height, cx, cy, scale) {
  const x = v => (from + to) / 2 + scale * (v - cx), y = v => height / 2 - scale * (v - cy);
  pen.save();
  pen.beginPath(); pen.rect(from, 0, to - from, height); pen.clip();
  for (const side of s.full ? [1] : [1, -1]) {
    for (let k = 0; k < cells.length; k += 3) {
      const [a, b, c] = [cells[k], cells[k + 1], cells[k + 2]];
      pen.fillStyle = pen.strokeStyle = shade((s.kPa[a] + s.kPa[b] + s.kPa[c]) / 3 / top);
      pen.lineWidth = 0.6;
      pen.beginPath(); pen.moveTo(x(side * s.x[a]), y(s.y[a])); pen.lineTo(x(side * s.x[b]), y(s.y[b])); pen.lineTo(x(side * s.x[c]), y(s.y[c]));
      pen.closePath(); pen.fill(); pen.stroke();
    }
  }
  pen.fillStyle = "#d9d9d9"; pen.strokeStyle = "#000"; pen.lineWidth = 1;
  pen.beginPath(); for (const [bx, by] of s.blade) pen.lineTo(x(bx), y(by));
  pen.closePath(); pen.fill(); pen.stroke();
  pen.restore();
}
