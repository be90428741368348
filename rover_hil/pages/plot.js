"use strict";
// Lines over time and seen from above on a canvas; shared by reports and the page of the bench.

// To be seen on white and on black.
const WHEEL_COLOURS = ["#3b82f6", "#e8890c", "#16a37b", "#a855f7", "#db4f9e", "#8f9d0a", "#1899b8", "#b07a45"];
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function prepared(canvas) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = "11px system-ui, 'DejaVu Sans', sans-serif";
  return [context, width, height];
}

function niceStep(span, count) {
  const raw = span / Math.max(count, 1), power = 10 ** Math.floor(Math.log10(raw));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= raw);
}

function label(value, step) {
  return value.toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
}

function line(context, xs, ys, toX, toY, style, width = 1.8, dash = []) {
  context.strokeStyle = style;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.beginPath();
  let isDown = false;
  for (let index = 0; index < xs.length; index++) {
    if (!Number.isFinite(ys[index])) { isDown = false; continue; }
    const x = toX(xs[index]), y = toY(ys[index]);
    if (isDown) context.lineTo(x, y); else context.moveTo(x, y);
    isDown = true;
  }
  context.stroke();
  context.setLineDash([]);
}

function legend(context, entries, x, y) {
  for (const [name, style] of entries) {
    context.fillStyle = style;
    context.fillRect(x, y - 4, 12, 3);
    context.fillStyle = colour("--ink");
    context.fillText(name, x + 16, y);
    x += 28 + context.measureText(name).width;
  }
}
