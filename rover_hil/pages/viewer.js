"use strict";
// Runs on one time axis: what is chosen on one chart is shown on all of them, and on the way seen from above.

const shown = JSON.parse(document.getElementById("viewer-data").textContent);
const place = document.getElementById("viewer"), several = shown.runs.length > 1;
const whole = [0, Math.max(1e-3, ...shown.runs.map((run) => run.duration_s))];
const LEFT = 52, RIGHT = 8, LEAST_SPAN_S = 0.05, CLICK_PX = 5;
const NAMED = { estimate: "--estimate", encoders: "--encoders", truth: "--truth", work: "--estimate" };
const off = new Set();
const charts = [];
let span = [...whole], cursorS = null, picked = null, isDrawn = true;
const held = new Map();

// "wheel 1, setpoint" has the colour of "wheel 1", dashed.
const baseOf = (name) => name.split(", ")[0], isSecond = (name) => name !== baseOf(name) || name === "truth";
const namesOf = (chart) => [...new Set(shown.runs.flatMap((run) => curvesOf(run, chart).map((curve) => curve.name)))];
const curvesOf = (run, chart) => (chart === "path" ? run.paths : run.charts[chart] || []);

function styleOf(run, chart, name) {
  if (several) return run.colour;
  if (NAMED[name]) return colour(NAMED[name]);
  const bases = [...new Set(namesOf(chart).map(baseOf))].filter((base) => !NAMED[base]);
  const taken = namesOf(chart).some((other) => NAMED[other]) ? 2 : 0;
  return WHEEL_COLOURS[(taken + bases.indexOf(baseOf(name))) % WHEEL_COLOURS.length];
}

function dashOf(chart, name) {
  if (!several) return isSecond(name) ? [6, 3] : [];
  const index = namesOf(chart).filter((other) => other !== "estimate").indexOf(name);
  return name === "estimate" || index < 0 ? [] : name === "truth" ? [2, 2] : index === 0 && !namesOf(chart).includes("estimate") ? [] : [3 + 3 * index, 3];
}

function element(kind, parent, words = "", name = "") {
  const made = parent.appendChild(document.createElement(kind));
  made.textContent = words;
  made.className = name;
  return made;
}

// Of several runs only what is to be compared: the rest can be switched on.
function hideSeconds() {
  for (const [key] of [["path"], ...shown.charts]) {
    const names = namesOf(key);
    for (const name of names) if (name !== baseOf(name) || (name === "encoders" && names.includes("estimate"))) off.add(key + "/" + name);
  }
}

function build() {
  if (several) hideSeconds();
  const tools = element("div", place, "", "tools");
  const times = { "−": () => zoom(0.5, 2), "+": () => zoom(0.5, 0.5), "◀": () => move(-0.5), "▶": () => move(0.5), "whole run": () => choose(...whole) };
  const names = { "−": "show more time", "+": "show less time", "◀": "earlier", "▶": "later" };
  for (const [words, act] of Object.entries(times)) {
    const button = element("button", tools, words);
    button.type = "button";
    button.ariaLabel = button.title = names[words] || words;
    button.addEventListener("click", act);
  }
  element("span", tools, "", "time");
  if (several) {
    const runs = element("div", place, "", "legend");
    for (const run of shown.runs) sample(element("span", runs, run.name), run.colour);
  }
  for (const [key, title, unit] of [["path", "Path", "m"], ...shown.charts]) {
    const names = namesOf(key);
    if (!names.length) continue;
    element("h3", place, title).append(Object.assign(document.createElement("small"), { textContent: " " + unit }));
    const legend = element("div", place, "", "legend"), entries = {};
    for (const name of names) {
      const entry = element("button", legend, name);
      entry.type = "button";
      entry.title = "show or hide";
      entry.addEventListener("click", () => { const id = key + "/" + name; if (!off.delete(id)) off.add(id); redraw(); });
      entries[name] = entry;
    }
    const canvas = element("canvas", place, "", key === "path" ? "path" : "");
    canvas.setAttribute("role", "img");
    canvas.ariaLabel = title;
    charts.push({ key, canvas, entries });
    if (key !== "path") listen(canvas);
  }
  addEventListener("resize", redraw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  redraw();
}

function sample(entry, style, dash = false) {
  entry.style.setProperty("--line-of", style);
  entry.classList.toggle("dashed", dash);
}

// ---- choosing a time ----

function choose(begin, end) {
  const length = Math.min(whole[1], Math.max(LEAST_SPAN_S, end - begin));
  const first = Math.min(Math.max(0, begin), whole[1] - length);
  span = [first, first + length];
  redraw();
}

const zoom = (share, factor) => { const at = span[0] + share * (span[1] - span[0]), length = factor * (span[1] - span[0]); choose(at - share * length, at + (1 - share) * length); };
const move = (share) => { const step = share * (span[1] - span[0]); choose(span[0] + step, span[1] + step); };
const shareAt = (canvas, event) => (event.clientX - canvas.getBoundingClientRect().left - LEFT) / (canvas.clientWidth - LEFT - RIGHT);
const timeAt = (canvas, event) => span[0] + Math.min(1, Math.max(0, shareAt(canvas, event))) * (span[1] - span[0]);

function listen(canvas) {
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, event);
    if (event.pointerType === "mouse") picked = [timeAt(canvas, event), timeAt(canvas, event)];
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = held.get(event.pointerId), others = [...held.values()].filter((other) => other.pointerId !== event.pointerId);
    cursorS = timeAt(canvas, event);
    if (picked) picked[1] = cursorS;
    else if (before && others.length) {
      const other = others[0], was = Math.abs(before.clientX - other.clientX), is = Math.abs(event.clientX - other.clientX);
      const between = (shareAt(canvas, event) + shareAt(canvas, other)) / 2;
      if (was > 10 && is > 10) zoom(between, was / is);
    } else if (before) move((before.clientX - event.clientX) / (canvas.clientWidth - LEFT - RIGHT));
    if (before) held.set(event.pointerId, event);
    redraw();
  });
  const end = (event) => {
    held.delete(event.pointerId);
    if (!picked) return;
    const [a, b] = [Math.min(...picked), Math.max(...picked)];
    const wide = (b - a) / (span[1] - span[0]) * canvas.clientWidth > CLICK_PX;
    picked = null;
    if (wide && event.type === "pointerup") choose(a, b);
    redraw();
  };
  canvas.addEventListener("pointerup", end);
  canvas.addEventListener("pointercancel", end);
  canvas.addEventListener("pointerleave", () => { cursorS = null; redraw(); });
  canvas.addEventListener("dblclick", () => choose(...whole));
  canvas.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.shiftKey) return;
    event.preventDefault();
    zoom(Math.min(1, Math.max(0, shareAt(canvas, event))), (event.deltaY || event.deltaX) > 0 ? 1.25 : 0.8);
  }, { passive: false });
}

// ---- drawing ----

function firstAfter(times, t) {
  let low = 0, high = times.length;
  while (low < high) { const middle = (low + high) >> 1; if (times[middle] < t) low = middle + 1; else high = middle; }
  return low;
}

// One point more on each side, so that lines reach the edge.
const inside = (times) => [Math.max(0, firstAfter(times, span[0]) - 1), Math.min(times.length, firstAfter(times, span[1]) + 1)];

function* visible(chart) {
  for (const run of shown.runs) for (const curve of curvesOf(run, chart)) {
    if (!off.has(chart + "/" + curve.name)) yield [run, curve, styleOf(run, chart, curve.name), dashOf(chart, curve.name)];
  }
}

function extremes(values, range) {
  for (const value of values) if (Number.isFinite(value)) { range[0] = Math.min(range[0], value); range[1] = Math.max(range[1], value); }
  return range;
}

function drawTimes(chart) {
  const [context, width, height] = prepared(chart.canvas), bottom = height - 18, top = 6, range = [0, 0];
  const drawn = [...visible(chart.key)].map(([run, curve, style, dash]) => {
    const [from, to] = inside(curve.x);
    return [curve.x.slice(from, to), curve.y.slice(from, to), style, dash];
  });
  for (const [, ys] of drawn) extremes(ys, range);
  if (range[1] - range[0] < 1e-9) range[1] = range[0] + 1;
  const toX = (t) => LEFT + (width - LEFT - RIGHT) * (t - span[0]) / (span[1] - span[0]);
  const toY = (value) => bottom - (bottom - top) * (value - range[0]) / (range[1] - range[0]);
  const shade = (begin, end, style) => { context.fillStyle = style; context.fillRect(toX(begin), top, Math.max(1, toX(end) - toX(begin)), bottom - top); };
  for (const run of shown.runs) for (const [begin, end] of run.stops) if (end > span[0] && begin < span[1]) shade(Math.max(begin, span[0]), Math.min(end, span[1]), colour("--stopped"));
  context.strokeStyle = colour("--line");
  context.fillStyle = colour("--soft");
  context.lineWidth = 1;
  const step = niceStep(range[1] - range[0], 4), timeStep = niceStep(span[1] - span[0], width / 110);
  context.textAlign = "right";
  for (let value = Math.ceil(range[0] / step) * step; value <= range[1] + 1e-9; value += step) {
    context.beginPath(); context.moveTo(LEFT, toY(value)); context.lineTo(width - RIGHT, toY(value)); context.stroke();
    context.fillText(label(value, step), LEFT - 6, toY(value) + 4);
  }
  context.textAlign = "center";
  for (let t = Math.ceil(span[0] / timeStep) * timeStep; t <= span[1] + 1e-9; t += timeStep) context.fillText(label(t, timeStep) + " s", Math.min(toX(t), width - 18), height - 4);
  context.textAlign = "left";
  context.save();
  context.beginPath(); context.rect(LEFT, 0, width - LEFT - RIGHT, height); context.clip();
  for (const [xs, ys, style, dash] of drawn) line(context, xs, ys, toX, toY, style, 1.5, dash);
  if (picked) shade(Math.min(...picked), Math.max(...picked), colour("--estimate") + "33");
  if (cursorS !== null) { context.fillStyle = colour("--soft"); context.fillRect(toX(cursorS), top, 1, bottom - top); }
  context.restore();
}

function drawWay(chart) {
  const [context, width, height] = prepared(chart.canvas), across = [Infinity, -Infinity], along = [Infinity, -Infinity];
  const ways = [...visible("path")].map(([run, way, style, dash]) => [way, style, dash, inside(way.t)]);
  for (const [way, , , [from, to]] of ways) { extremes(way.x.slice(from, to), across); extremes(way.y.slice(from, to), along); }
  const isWhole = span[0] === whole[0] && span[1] === whole[1];
  if (isWhole) for (const run of shown.runs) { extremes(run.mission.map((p) => p[0]), across); extremes(run.mission.map((p) => p[1]), along); }
  if (across[0] > across[1]) { across[0] = along[0] = 0; across[1] = along[1] = 1; }
  const scale = Math.min((width - LEFT - 30) / Math.max(across[1] - across[0], 0.02), (height - 46) / Math.max(along[1] - along[0], 0.02));
  const middle = [(across[0] + across[1]) / 2, (along[0] + along[1]) / 2];
  const toX = (x) => (LEFT + width) / 2 + scale * (x - middle[0]), toY = (y) => (height - 18) / 2 - scale * (y - middle[1]);
  const toWorld = (px, py) => [middle[0] + (px - (LEFT + width) / 2) / scale, middle[1] + ((height - 18) / 2 - py) / scale];
  context.strokeStyle = colour("--line");
  context.fillStyle = colour("--soft");
  const [left, top] = toWorld(LEFT, 0), [right, bottom] = toWorld(width, height - 18), step = niceStep(right - left, width / 110);
  context.textAlign = "center";
  for (let x = Math.ceil(left / step) * step; x <= right; x += step) {
    context.beginPath(); context.moveTo(toX(x), 0); context.lineTo(toX(x), height - 18); context.stroke();
    if (toX(x) < width - 14) context.fillText(label(x, step), toX(x), height - 4);
  }
  context.textAlign = "right";
  for (let y = Math.ceil(bottom / step) * step; y <= top; y += step) {
    context.beginPath(); context.moveTo(LEFT, toY(y)); context.lineTo(width, toY(y)); context.stroke();
    if (toY(y) > 8) context.fillText(label(y, step), LEFT - 6, toY(y) + 4);
  }
  context.textAlign = "left";
  context.save();
  context.beginPath(); context.rect(LEFT, 0, width - LEFT, height - 18); context.clip();
  for (const run of shown.runs) line(context, run.mission.map((p) => p[0]), run.mission.map((p) => p[1]), toX, toY, colour("--mission"), 1.4, [2, 4]);
  for (const run of shown.runs) line(context, run.area.map((p) => p[0]), run.area.map((p) => p[1]), toX, toY, colour("--bad"), 1.2, [8, 4]);
  for (const [way, style, dash, [from, to]] of ways) {
    context.globalAlpha = 0.3;
    line(context, way.x, way.y, toX, toY, style, 1.2, dash);
    context.globalAlpha = 1;
    line(context, way.x.slice(from, to), way.y.slice(from, to), toX, toY, style, 2, dash);
    const at = cursorS === null ? to - 1 : Math.min(way.t.length - 1, firstAfter(way.t, cursorS));
    if (at >= 0) { context.fillStyle = style; context.beginPath(); context.arc(toX(way.x[at]), toY(way.y[at]), 4.5, 0, 7); context.fill(); }
  }
  context.restore();
}

function describe(chart) {
  for (const [name, entry] of Object.entries(chart.entries)) {
    entry.setAttribute("aria-pressed", String(!off.has(chart.key + "/" + name)));
    sample(entry, several ? colour("--soft") : styleOf(shown.runs[0], chart.key, name), dashOf(chart.key, name).length > 0);
    const values = cursorS === null || chart.key === "path" ? [] : shown.runs.map((run) => {
      const curve = curvesOf(run, chart.key).find((other) => other.name === name);
      const value = curve && curve.y[Math.min(curve.y.length - 1, firstAfter(curve.x, cursorS))];
      return Number.isFinite(value) ? Number(value.toPrecision(4)) : "–";
    });
    entry.textContent = values.length ? `${name} ${values.join(" / ")}` : name;
  }
}

function draw() {
  isDrawn = true;
  const digits = Math.max(1, 2 - Math.floor(Math.log10(span[1] - span[0])));
  place.querySelector(".time").textContent = `${span[0].toFixed(digits)} … ${span[1].toFixed(digits)} s` + (cursorS === null ? "" : `, at ${cursorS.toFixed(digits)} s`);
  for (const chart of charts) {
    describe(chart);
    if (chart.key === "path") drawWay(chart); else drawTimes(chart);
  }
}

function redraw() {
  if (isDrawn) { isDrawn = false; requestAnimationFrame(draw); }
}

build();
