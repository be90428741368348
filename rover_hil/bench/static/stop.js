"use strict";
// The emergency stop: sent on a separate connection, and again until it is acknowledged, also when the page reloads. On
// the same connection this script answers the server: while it hangs, stop button and keys do too, and the rover stops.

const PRESS_AGAIN_MS = 250, ALARM_MS = 1000, FRESH_MS = 1000, LINE_AGAIN_MS = 500, LINE_LOST_MS = 2000;
const STORED = "rover_hil emergency stop";
const alarm = document.getElementById("bench-alarm");
let stopLine = null, lineTriedMs = -Infinity, numbers = 0;
let press = null; // The stop that is not acknowledged yet: number, run, times of this and of the first press, answer.
let goesOn = null; // The run that an answer reported, and the one that the page showed then.

// ---- the connection: WebSockets do not count among the few connections that a browser makes to one server ----

function openLine() {
  lineTriedMs = performance.now();
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/line${location.search}`);
  stopLine = socket;
  socket.onopen = () => {
    if (socket !== stopLine) return;
    socket.send(JSON.stringify({ browser: document.getElementById("bench-bar").dataset.browser }));
    if (press) sendOnLine();
  };
  socket.onmessage = (event) => {
    const message = JSON.parse(event.data);
    // Here and not in a timer: those of a hidden tab are slowed down.
    if (message.ask !== undefined) socket.send(JSON.stringify({ answer: message.ask }));
    else acknowledge(message);
  };
  socket.onclose = () => { if (socket === stopLine) setTimeout(openLine, LINE_AGAIN_MS); };
}

// A connection that is lost without a word looks open for minutes.
function renewLine() {
  const socket = stopLine;
  openLine();
  socket.close();
}

// ---- the press ----

function emergencyStop() {
  const pressedMs = performance.now(), sinceMs = press?.sinceMs ?? pressedMs;
  if (!press) alarm.hidden = true;
  press = { number: ++numbers, run: knownRun(), pressedMs, sinceMs, postedMs: -Infinity, answer: null };
  sendPress();
  store();
}

// An answer may be newer than the stream.
function knownRun() {
  return goesOn && goesOn.shown === live.run ? goesOn.run : live.run ?? "";
}

// NiceGUI may reload the page after a lost connection. A browser that stores nothing still sends from this page.
function store() {
  try {
    if (!press) sessionStorage.removeItem(STORED);
    else sessionStorage.setItem(STORED, JSON.stringify({ run: press.run, sinceMs: performance.timeOrigin + press.sinceMs }));
  } catch {}
}

function restore() {
  try {
    const stored = JSON.parse(sessionStorage.getItem(STORED));
    if (!stored) return;
    const sinceMs = Math.min(stored.sinceMs - performance.timeOrigin, performance.now());
    // Pressed long ago: it is for its run only.
    press = { number: ++numbers, run: stored.run, pressedMs: -Infinity, sinceMs, postedMs: -Infinity, answer: null };
  } catch {}
}

function sendOnLine() {
  stopLine.send(JSON.stringify({ press: press.number, run: press.run }));
}

function sendPress() {
  if (!press) return;
  const nowMs = performance.now(), isLate = nowMs - press.sinceMs >= ALARM_MS;
  const isOpen = stopLine.readyState === WebSocket.OPEN;
  if (isOpen) sendOnLine();
  if ((isLate || !isOpen) && nowMs - press.postedMs >= ALARM_MS) {
    const { number } = press;
    press.postedMs = nowMs;
    fetch(`/stop?run=${encodeURIComponent(press.run)}`, { method: "POST", signal: AbortSignal.timeout(ALARM_MS) })
      .then((answer) => answer.json())
      .then((answer) => acknowledge({ ...answer, press: number }))
      .catch(() => {});
  }
  if (isLate) showAlarm(nowMs);
  if (isLate && !press.answer && nowMs - Math.max(lineTriedMs, press.sinceMs) >= LINE_LOST_MS) renewLine();
}

function showAlarm(nowMs) {
  const since = `${((nowMs - press.sinceMs) / 1000).toFixed(0)} s`;
  const what = press.answer === "sent" ? "the rover's loop has not confirmed it" : "the program of the rover does not answer";
  alarm.textContent = `EMERGENCY STOP NOT CONFIRMED for ${since}: ${what}. Stop the rover by its own switch. It is sent again and again.`;
  alarm.hidden = false;
}

function acknowledge({ press: number, answer, run }) {
  if (number !== press?.number) return;
  press.answer = answer;
  if (answer === "sent") return;
  if (answer === "ended") { press = null; store(); alarm.hidden = true; return; }
  // Another run: who has pressed just now means it. Later nobody's run is stopped in silence.
  if (performance.now() - press.pressedMs < FRESH_MS) { press.run = run; sendPress(); store(); return; }
  press = null;
  store();
  goesOn = { shown: live.run, run };
  alarm.textContent = "The run for which you pressed EMERGENCY STOP has ended, another one goes on: press again to stop it.";
  alarm.hidden = false;
}

// ---- after a stop that waits for the operator ----

// Only for the stops that this page knows of: a click that was on its way while another one began does not count. Nor does
// a click that waited while this script hung: the button was not there yet.
function confirmMotion(event) {
  if (event.timeStamp < askedMs) return;
  if (stopLine.readyState === WebSocket.OPEN) stopLine.send(JSON.stringify({ confirm: live.last.stops }));
}

document.getElementById("bench-stop").addEventListener("click", emergencyStop);
document.getElementById("bench-confirm").addEventListener("click", confirmMotion);
// A key that is held would click again and again.
document.getElementById("bench-confirm").addEventListener("keydown", (event) => { if (event.repeat) event.preventDefault(); });
setInterval(sendPress, PRESS_AGAIN_MS);
restore();
openLine();
