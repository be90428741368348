"use strict";
// Draws what the server streams, and sends driving by hand; stop.js sends the emergency stop. All else is NiceGUI's.

const MOST_POINTS = 6000, SHOWN_S = 60, DRIVE_MS = 50, SILENT_MS = 1500;
const RUN_COLOURS = ["#9b4dca", "#0f8a5f"];
const live = { run: null, state: {}, last: null, x: [], y: [], ox: [], oy: [], tx: [], ty: [], series: {} };
let opened = [], points = [], heardMs = performance.now(), askedMs = Infinity, view = null;
const byId = (id) => document.getElementById(id);

// ---- stream ----

function begin(run) {
  Object.assign(live, { run, last: null, x: [], y: [], ox: [], oy: [], tx: [], ty: [], series: {} });
}

function put(chart, name, t, value) {
  const curves = (live.series[chart] ??= {});
  const curve = (curves[name] ??= { x: [], y: [] });
  curve.x.push(t);
  curve.y.push(value);
  while (curve.x.length && curve.x[0] < t - SHOWN_S) { curve.x.shift(); curve.y.shift(); }
}

function unwrapped(chart, name, degrees) {
  const curve = live.series[chart]?.[name];
  const before = curve?.y.length ? curve.y[curve.y.length - 1] : null;
  return before === null ? degrees : degrees + 360 * Math.round((before - degrees) / 360);
}

const toDegrees = 180 / Math.PI;
const zero = {};

function take(v) {
  live.last = v;
  const places = [[live.x, v.pose[0]], [live.y, v.pose[1]], [live.ox, v.odometry[0]], [live.oy, v.odometry[1]]];
  if (v.truth) places.push([live.tx, v.truth[0]], [live.ty, v.truth[1]]);
  for (const [list, value] of places) {
    list.push(value);
    if (list.length > MOST_POINTS) list.splice(0, list.length, ...list.filter((_, index) => index % 2));
  }
  v.slip.forEach((value, index) => put("slip", v.slip_names[index], v.t_s, value === null ? NaN : 100 * value));
  v.current_a.forEach((value, index) => { if (value !== null) put("currents", "wheel " + index, v.t_s, value); });
  put("headings", "estimate", v.t_s, unwrapped("headings", "estimate", v.pose[2] * toDegrees));
  put("headings", "encoders", v.t_s, unwrapped("headings", "encoders", v.odometry[2] * toDegrees));
  for (const [name, value] of Object.entries(v.headings)) {
    if (!live.series.headings[name]) zero[name] = value - v.pose[2];
    put("headings", name, v.t_s, unwrapped("headings", name, (value - zero[name]) * toDegrees));
  }
  if (v.truth) put("headings", "truth", v.t_s, unwrapped("headings", "truth", v.truth[2] * toDegrees));
  put("cycles", "work", v.t_s, v.work_us / 1000);
  put("cycles", "late", v.t_s, v.late_us / 1000);
}

function receive(event) {
  heardMs = performance.now();
  const data = JSON.parse(event.data);
  if (data.run !== live.run) begin(data.run);
  live.state = data;
  data.views.forEach(take);
  repeatDriving();
  showCameras(data);
  showWords();
}

const isSilent = () => performance.now() - heardMs > SILENT_MS;

function showWords() {
  const data = live.state, v = live.last;
  let mode = data.state === "running" && v ? v.mode.replace("_", " ") : data.state || "connecting";
  if (isSilent()) mode = "not connected";
  const badge = byId("bench-mode");
  badge.textContent = mode;
  badge.dataset.mode = mode;
  const words = [];
  if (data.is_real) words.push("REAL ROVER");
  if (v && data.state === "running") words.push(v.t_s.toFixed(1) + " s", v.reason);
  words.push(data.message);
  byId("bench-words").textContent = words.filter(Boolean).join(" · ");
  byId("bench-words").title = byId("bench-words").textContent;
  showTables(v, data);
  showWait();
}

function showWait() {
  const v = live.last, waits = live.state.state === "running" && Boolean(v?.waits_for_operator);
  if (waits && byId("bench-wait").hidden) askedMs = performance.now();
  byId("bench-wait").hidden = !waits;
  if (!waits) return;
  const hasControl = live.state.controller === byId("bench-bar").dataset.browser;
  byId("bench-confirm").hidden = !hasControl;
  byId("bench-why").textContent = `STOPPED: ${v.reason}. ` + (hasControl
    ? "Look at the rover and its surroundings." : "Only the page in control can let it move again.");
}

function showCameras(data) {
  const place = byId("bench-cameras");
  if (!place) return;
  for (const [name, [number, words]] of Object.entries(data.pictures)) {
    let figure = place.querySelector(`[data-camera="${CSS.escape(name)}"]`);
    if (!figure) {
      if (!place.children.length) place.textContent = "";
      figure = place.appendChild(document.createElement("figure"));
      figure.dataset.camera = name;
      figure.append(document.createElement("img"), document.createElement("figcaption"));
    }
    const [picture, caption] = figure.children, key = `${data.run}-${number}`;
    // A picture that is still on its way is not overtaken: a slow network shows fewer ones.
    if (figure.dataset.key === key || (picture.src && !picture.complete)) continue;
    figure.dataset.key = key;
    picture.alt = "camera " + name;
    picture.src = `/camera/${encodeURIComponent(name)}?${key}`;
    caption.textContent = words ? `${name}: ${words}` : name;
  }
}

function cell(text, kind) {
  const element = document.createElement("td");
  element.textContent = text;
  if (kind) element.className = kind;
  return element;
}

function fill(id, rows) {
  const body = byId(id);
  if (!body) return;
  body.replaceChildren(...rows.map((cells) => {
    const row = document.createElement("tr");
    row.replaceChildren(...cells);
    return row;
  }));
}

function showTables(v, data) {
  if (!v) return;
  fill("bench-devices", v.devices.map((device) => [
    cell(device.name),
    cell(device.state, device.state === "streaming" ? "good" : "bad"),
    cell(device.rate_hz.toFixed(0) + " Hz"),
    cell(device.age_s === null ? "–" : (1000 * device.age_s).toFixed(0) + " ms"),
    cell(device.reason, "bad"),
  ]));
  const sigma = Math.sqrt(Math.max(v.covariance[0] + v.covariance[2], 0));
  fill("bench-facts", [
    ["position", `${v.pose[0].toFixed(3)}, ${v.pose[1].toFixed(3)} m ± ${(100 * sigma).toFixed(1)} cm`],
    ["yaw", `${(v.pose[2] * toDegrees).toFixed(1)}° ± ${(Math.sqrt(Math.max(v.covariance[3], 0)) * toDegrees).toFixed(1)}°`],
    ["distance from the truth", v.truth ? (100 * Math.hypot(v.pose[0] - v.truth[0], v.pose[1] - v.truth[1])).toFixed(1) + " cm" : "– (only of a simulated rover)"],
    ["beside the path", v.cross_track_m === null ? "–" : (100 * v.cross_track_m).toFixed(1) + " cm"],
    ["setpoints", v.set_rad_s.map((speed) => speed.toFixed(2)).join(" / ") + " rad/s" + (v.limit === "none" ? "" : ", limit: " + v.limit)],
    ["log", data.run_name ? `${data.run_name}, ${(data.log_bytes / 1e6).toFixed(2)} MB, ${v.cycles} cycles` : "closed"],
    ["slip not valid or unsure", v.slip_reason || "–"],
    ["may be wrong", v.suspicion || "–"],
    ["ground", v.assumed || "–"],
    ["orders refused", data.refused ? `${data.refused}: no finite numbers` : "none"],
    ["behind real time", v.lost_s > 0.05 ? v.lost_s.toFixed(1) + " s: this computer is too slow" : "no"],
  ].map(([name, value]) => [cell(name), cell(value)]));
}

// ---- drawing ----

// Finished runs that are opened take the place of the run that has just ended.
const nothing = { last: null, x: [], y: [], ox: [], oy: [], tx: [], ty: [], series: {} };
const present = () => (opened.length && live.state.state === "idle" ? nothing : live);

function drawPath(canvas) {
  const now = present();
  const [context, width, height] = prepared(canvas);
  const mission = live.state.mission || [], area = live.state.area || [];
  const xs = [0, ...mission.map((p) => p[0]), ...points.map((p) => p[0])];
  const ys = [0, ...mission.map((p) => p[1]), ...points.map((p) => p[1])];
  const extend = (list, values) => { for (const value of values) list.push(value); };
  for (const list of [now.x, now.ox, now.tx]) extend(xs, list);
  for (const list of [now.y, now.oy, now.ty]) extend(ys, list);
  for (const run of opened) for (const curve of run.paths) { extend(xs, curve.x); extend(ys, curve.y); }
  const bound = (list, pick) => list.reduce((a, b) => pick(a, b));
  const [x0, x1, y0, y1] = [bound(xs, Math.min), bound(xs, Math.max), bound(ys, Math.min), bound(ys, Math.max)];
  const margin = 44, span = Math.max(x1 - x0, 0.4), rise = Math.max(y1 - y0, 0.4);
  const scale = Math.min((width - 2 * margin) / span, (height - 2 * margin) / rise);
  const toX = (x) => width / 2 + scale * (x - (x0 + x1) / 2), toY = (y) => height / 2 - scale * (y - (y0 + y1) / 2);
  view = { toWorld: (px, py) => [(px - width / 2) / scale + (x0 + x1) / 2, (height / 2 - py) / scale + (y0 + y1) / 2] };
  const step = niceStep(width / scale, 8);
  context.strokeStyle = colour("--line");
  context.fillStyle = colour("--faint");
  context.lineWidth = 1;
  const [left, top] = view.toWorld(0, 0), [right, bottom] = view.toWorld(width, height);
  for (let x = Math.ceil(left / step) * step; x <= right; x += step) {
    context.beginPath(); context.moveTo(toX(x), 0); context.lineTo(toX(x), height - 16); context.stroke();
    context.fillText(label(x, step) + " m", toX(x) - 10, height - 4);
  }
  for (let y = Math.ceil(bottom / step) * step; y <= top; y += step) {
    context.beginPath(); context.moveTo(0, toY(y)); context.lineTo(width, toY(y)); context.stroke();
    context.fillText(label(y, step), 2, toY(y) - 3);
  }
  line(context, mission.map((p) => p[0]), mission.map((p) => p[1]), toX, toY, colour("--mission"), 1.5, [6, 5]);
  line(context, area.map((p) => p[0]), area.map((p) => p[1]), toX, toY, colour("--alarm"), 1.2, [8, 4]);
  const entries = [["mission", colour("--mission")]];
  if (area.length) entries.push(["area", colour("--alarm")]);
  if (now === live) entries.push(["encoders", colour("--encoders")], ["estimate", colour("--estimate")]);
  if (now.tx.length) entries.push(["truth", colour("--truth")]);
  opened.forEach((run, index) => {
    for (const curve of run.paths) {
      const dash = curve.name === "encoders" ? [2, 4] : curve.name === "truth" ? [9, 4] : [];
      line(context, curve.x, curve.y, toX, toY, RUN_COLOURS[index % 2], 1.6, dash);
    }
    entries.push([run.name, RUN_COLOURS[index % 2]]);
  });
  line(context, now.tx, now.ty, toX, toY, colour("--truth"), 1.6, [9, 4]);
  line(context, now.ox, now.oy, toX, toY, colour("--encoders"), 1.4);
  line(context, now.x, now.y, toX, toY, colour("--estimate"), 2.2);
  if (points.length) {
    const all = [[0, 0], ...points];
    line(context, all.map((p) => p[0]), all.map((p) => p[1]), toX, toY, colour("--good"), 1.6, [3, 3]);
    context.fillStyle = colour("--good");
    points.forEach((p, index) => {
      context.beginPath(); context.arc(toX(p[0]), toY(p[1]), 4, 0, 7); context.fill();
      context.fillText(String(index + 1), toX(p[0]) + 6, toY(p[1]) - 6);
    });
  }
  if (now.last) drawRover(context, now.last, toX, toY, scale);
  if (width > 420 || entries.length < 4) legend(context, entries, 40, 14);
  else { legend(context, entries.slice(0, 3), 40, 14); legend(context, entries.slice(3), 40, 28); }
}

// Semi-axes of the ellipse that holds a normal distribution of two dimensions with 95 %, in standard deviations.
const region95 = Math.sqrt(-2 * Math.log(0.05));

function drawRover(context, v, toX, toY, scale) {
  const [xx, xy, yy] = v.covariance, [x, y, yaw] = v.pose;
  const mean = (xx + yy) / 2, half = Math.hypot((xx - yy) / 2, xy);
  const long = region95 * Math.sqrt(Math.max(mean + half, 0)), short = region95 * Math.sqrt(Math.max(mean - half, 0));
  const turn = 0.5 * Math.atan2(2 * xy, xx - yy);
  context.save();
  context.translate(toX(x), toY(y));
  context.rotate(-turn);
  context.beginPath();
  context.ellipse(0, 0, Math.max(long * scale, 1), Math.max(short * scale, 1), 0, 0, 7);
  context.fillStyle = colour("--estimate") + "33";
  context.strokeStyle = colour("--estimate");
  context.lineWidth = 1;
  // A region larger than the picture would hide the path: it is stated in words instead.
  const isLarge = 2 * long * scale > Math.max(context.canvas.clientWidth, context.canvas.clientHeight);
  if (!isLarge) context.fill();
  context.stroke();
  context.rotate(turn - yaw);
  context.beginPath();
  context.moveTo(14, 0); context.lineTo(-9, 8); context.lineTo(-5, 0); context.lineTo(-9, -8); context.closePath();
  context.fillStyle = colour("--estimate");
  context.fill();
  context.restore();
  if (isLarge) context.fillText(`the 95 % region reaches ${long.toFixed(1)} m, farther than this picture`, 40, 42);
}

function drawSeries(canvas, chart) {
  const [context, width, height] = prepared(canvas);
  const series = present().series[chart] || {}, isLive = Object.keys(series).length > 0;
  const curves = [];
  Object.entries(series).forEach(([name, curve], index) => {
    const named = { estimate: colour("--estimate"), encoders: colour("--encoders"), truth: colour("--truth"), work: colour("--estimate"), late: colour("--encoders") };
    curves.push({ name, x: curve.x, y: curve.y, style: named[name] || WHEEL_COLOURS[index % WHEEL_COLOURS.length] });
  });
  if (!isLive) opened.forEach((run, run_index) => (run.charts[chart] || []).forEach((curve, index) => {
    const style = opened.length > 1 ? RUN_COLOURS[run_index] : WHEEL_COLOURS[index % WHEEL_COLOURS.length];
    curves.push({ ...curve, style, dash: opened.length > 1 && index ? [2 + index, 3] : [] });
  }));
  const values = curves.flatMap((curve) => curve.y.filter(Number.isFinite));
  context.fillStyle = colour("--faint");
  if (!values.length) {
    context.fillText(chart === "slip" ? "no valid slip yet, or no slip estimation configured" : "no data yet", 46, height / 2);
    return;
  }
  const extreme = (list, pick) => list.reduce((a, b) => pick(a, b));
  let low = Math.min(0, extreme(values, Math.min)), high = Math.max(0, extreme(values, Math.max));
  if (high - low < 1e-9) high = low + 1;
  const times = curves.flatMap((curve) => [curve.x[0], curve.x[curve.x.length - 1]]).filter(Number.isFinite);
  const end = Math.max(...times), begin = isLive ? Math.max(0, end - SHOWN_S) : Math.min(...times);
  const left = 44, top = 20, bottom = height - 16;
  const toX = (t) => left + (width - left - 6) * (t - begin) / Math.max(end - begin, 1e-3);
  const toY = (value) => bottom - (bottom - top) * (value - low) / (high - low);
  const step = niceStep(high - low, 4);
  context.lineWidth = 1;
  context.strokeStyle = colour("--line");
  for (let value = Math.ceil(low / step) * step; value <= high + 1e-9; value += step) {
    context.beginPath(); context.moveTo(left, toY(value)); context.lineTo(width, toY(value)); context.stroke();
    context.textAlign = "right";
    context.fillText(label(value, step), left - 5, toY(value) + 4);
  }
  context.textAlign = "left";
  const timeStep = niceStep(Math.max(end - begin, 1e-3), 5);
  for (let t = Math.ceil(begin / timeStep) * timeStep; t <= end; t += timeStep) context.fillText(label(t, timeStep) + " s", toX(t) - 8, height - 3);
  for (const curve of curves) line(context, curve.x, curve.y, toX, toY, curve.style, 1.5, curve.dash);
  const shown = opened.length > 1 && !isLive ? opened.map((run, index) => [run.name, RUN_COLOURS[index]]) : curves.map((curve) => [curve.name, curve.style]);
  legend(context, shown, left, 11);
}

function draw() {
  for (const canvas of document.querySelectorAll("canvas[data-chart]")) {
    if (!canvas.clientWidth) continue;
    if (canvas.dataset.chart === "path") drawPath(canvas);
    else drawSeries(canvas, canvas.dataset.chart);
  }
}

// ---- orders ----

const KEYS = { ArrowUp: [1, 0], KeyW: [1, 0], ArrowDown: [-1, 0], KeyS: [-1, 0], ArrowLeft: [0, 1], KeyA: [0, 1], ArrowRight: [0, -1], KeyD: [0, -1] };
const SIDES = { KeyQ: 1, KeyE: -1 };
const held = new Set();
const DEAD_ZONE = 0.12;
const padsThatCount = new Set();
let stick = null, wasDriving = false, wasRestSent = false;

// Forward, left and turn of the gamepads, by their standard mapping. Each counts only after it was at rest: since the
// rover may move, since it was connected, and since the page has the focus. A stick that hangs or lies on its side
// does not start the rover.
function gamepads() {
  const total = [0, 0, 0];
  if (!document.hasFocus() || !navigator.getGamepads) { padsThatCount.clear(); return total; }
  for (const [index, pad] of [...navigator.getGamepads()].entries()) {
    if (!pad || !pad.connected) { padsThatCount.delete(index); continue; }
    const [side, ahead, right] = [0, 1, 2].map((axis) => {
      const value = Number(pad.axes[axis]) || 0;
      return Math.abs(value) < DEAD_ZONE ? 0 : value;
    });
    if (!side && !ahead && !right) padsThatCount.add(index);
    if (padsThatCount.has(index)) { total[0] -= ahead; total[1] -= right; total[2] -= side; }
  }
  return total;
}

function driving() {
  let [forward, left, turn] = gamepads();
  for (const code of held) {
    if (KEYS[code]) { forward += KEYS[code][0]; turn += KEYS[code][1]; }
    left += SIDES[code] || 0;
  }
  if (stick) { forward += stick[1]; turn -= stick[0]; }
  return [forward, left, turn].map((share) => Math.max(-1, Math.min(1, share)));
}

// Whether the rover follows commands by hand now. After a stop or a lost connection it does so only after keys, stick
// and gamepads were let go, and this was sent.
function followsHand() {
  const { kind, state } = live.state;
  return kind === "by hand" && state === "running" && live.last?.mode === "running" && !isSilent() && window.socket?.connected;
}

function repeatDriving() {
  if (!followsHand()) { release(); wasDriving = wasRestSent = false; return; }
  const wanted = driving(), isDriving = wanted.some((share) => share !== 0);
  if (isDriving || wasDriving || !wasRestSent) emitEvent("drive", wanted);
  wasDriving = isDriving;
  wasRestSent = true;
}

function isTyping(event) {
  return ["INPUT", "TEXTAREA"].includes(event.target.tagName);
}

function onKey(event) {
  if (event.type === "keydown" && event.code === "Escape") { if (!event.repeat) emergencyStop(); return; }
  if (isTyping(event) || !(KEYS[event.code] || SIDES[event.code]) || live.state.kind !== "by hand") return;
  event.preventDefault();
  if (event.repeat) return; // a key that was held before does not count
  const before = held.size;
  if (event.type === "keydown") held.add(event.code); else held.delete(event.code);
  if (held.size !== before) repeatDriving();
}

function release() {
  held.clear();
  padsThatCount.clear();
  delete byId("bench-stick")?.dataset.held;
  moveStick(null);
}

function letGo() { release(); repeatDriving(); }

function moveStick(share) {
  stick = share;
  const knob = byId("bench-knob");
  if (knob) knob.style.transform = share ? `translate(${49 * share[0]}px, ${-49 * share[1]}px)` : "";
}

function onStick(event) {
  const base = byId("bench-stick");
  if (!base) return;
  if (event.type === "pointerdown" && base.contains(event.target)) { base.setPointerCapture(event.pointerId); base.dataset.held = "1"; }
  if (!base.dataset.held) return;
  if (event.type === "pointerup" || event.type === "pointercancel") { delete base.dataset.held; moveStick(null); repeatDriving(); return; }
  const box = base.getBoundingClientRect();
  const x = (event.clientX - box.left - box.width / 2) / (box.width / 2), y = (box.top + box.height / 2 - event.clientY) / (box.height / 2);
  const length = Math.max(1, Math.hypot(x, y));
  moveStick([x / length, y / length]);
}

function onClick(event) {
  if (event.target.dataset?.chart !== "path" || !view) return;
  const box = event.target.getBoundingClientRect();
  points.push(view.toWorld(event.clientX - box.left, event.clientY - box.top).map((value) => Math.round(1000 * value) / 1000));
  emitEvent("points", points);
}

// ---- what the server calls ----

window.bench = {
  open: (runs) => { opened = runs; },
  clearPoints: () => { points = []; emitEvent("points", points); },
};

for (const name of ["keydown", "keyup"]) addEventListener(name, onKey);
for (const name of ["pointerdown", "pointermove", "pointerup", "pointercancel"]) addEventListener(name, onStick);
addEventListener("click", onClick);
addEventListener("blur", letGo);
document.addEventListener("visibilitychange", () => { if (document.hidden) letGo(); });
setInterval(repeatDriving, DRIVE_MS);
setInterval(showWords, 500);
const source = new EventSource("/stream");
source.onmessage = receive;
let drawnMs = 0;
function frame(now) {
  if (now - drawnMs > 60) { drawnMs = now; draw(); }
  requestAnimationFrame(frame);
}
requestAnimationFrame(frame);
