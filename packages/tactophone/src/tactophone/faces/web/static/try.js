// Try it: the microphone of this device, what the run detects, and a task: something smooth, then something rough.

import { dbfs, foldOnPhone, put, showFaults } from "./text.js";
import { Hero } from "./hero.js";
import { Feed } from "./feed.js";
import { Meter } from "./meter.js";
import { Microphone } from "./microphone.js";
import { Toggle } from "./press.js";
import { StateBar } from "./statebar.js";
import { AMPLITUDE, FREQUENCY, LONGEST, ROUGHNESS, STEP_COLUMNS, Timeline, TOUCH } from "./timeline.js";
import { Track } from "./track.js";

const $ = (id) => document.getElementById(id);
const SMOOTH = 1;
const ROUGH = 2;
const SETTLED = 30; // steps, 0.3 s: what a touch begins with is provisional
const HELD = 30; // settled steps: a stroke, not a touch in passing
const LIFTED = 10; // steps without contact that end a stroke
// Columns of the table of sound: feed.py.
const [, LOW, HIGH, LEVEL] = Array(4).keys();

const meter = new Meter($("microphone-meter"), "Level");
const found = new Set();
let stroke = { length: 0, [SMOOTH]: 0, [ROUGH]: 0, lifted: 0 };
const steps = new Track(STEP_COLUMNS, 110 * LONGEST);
const events = new Track(2, 400);
const hero = new Hero($("hero"));
const timeline = new Timeline($("timeline"));
let state = null;
let newest = 0; // stream time of the newest message

const microphone = new Microphone({
  onState: (text, live) => {
    put($("listen-state"), text);
    $("listen-state").classList.toggle("wrong", Boolean(text) && !live);
    listening.on = $("listen").ariaPressed = live;
    put($("listen"), live ? "Stop this microphone" : "Use this microphone");
  },
});
const listening = new Toggle($("listen"), { begin: () => microphone.start(), end: () => { if (microphone.on) microphone.stop(); } });
$("threshold").addEventListener("input", ({ target }) => {
  put($("threshold-now"), dbfs(target.valueAsNumber));
  feed.send({ action: "threshold_dbfs", value: target.valueAsNumber });
});

const simulated = () => Boolean(state?.source.includes("finger"));

function last({ rows, columns, numbers }, column) {
  return rows ? numbers[(rows - 1) * columns + column] : NaN;
}

/** The word of a whole stroke: what stood for three quarters of its settled part; one that wavers has none. */
function word({ [SMOOTH]: smooth, [ROUGH]: rough }) {
  const settled = smooth + rough;
  return settled < HELD ? 0 : [SMOOTH, ROUGH].find((kind) => stroke[kind] >= 0.75 * settled) ?? 0;
}

function count({ rows, columns, numbers }) {
  for (let row = 0; row < rows; row++) {
    const touch = numbers[row * columns + TOUCH];
    if (touch > 0) {
      stroke.lifted = 0;
      if (++stroke.length > SETTLED) stroke[touch]++;
    } else if (++stroke.lifted === LIFTED) {
      const kind = word(stroke);
      if (kind === SMOOTH || (kind === ROUGH && found.has(SMOOTH))) found.add(kind);
      stroke = { length: 0, [SMOOTH]: 0, [ROUGH]: 0, lifted: LIFTED };
    }
  }
  const task = !found.has(SMOOTH) ? "Stroke something smooth, and lift: a glass, a glossy table."
    : !found.has(ROUGH) ? "Now something rough: a brick, a file, coarse cloth."
      : "Both found. Try whatever is at hand.";
  put($("task"), simulated() ? "A simulated finger strokes smooth and rough things." : task);
}

function show({ header, tables }) {
  bar.take({ ...header, ...header.state }, tables.steps?.rows || tables.sound?.rows);
  if (header.waiting_for) return;
  state = header.state ?? state;
  if (header.state) {
    showFaults($("faults"), state.faults);
    put($("run"), simulated() ? "A simulated finger strokes; feel it here" : "Slide one device over something, feel it on the other");
    if (simulated()) bar.waiting = "Waiting for the simulated finger.";
    $("listen-panel").hidden = !["browser", "microphone", ""].includes(state.source);
    const held = document.activeElement === $("threshold");
    if (!held && Number.isFinite(state.threshold_dbfs)) $("threshold").value = state.threshold_dbfs;
    put($("threshold-now"), dbfs(held ? $("threshold").valueAsNumber : state.threshold_dbfs));
    put($("floor"), state.noise_floor_dbfs === null ? "" : `Noise floor ${dbfs(state.noise_floor_dbfs)}. The threshold follows it until you set one.`);
  }
  if (tables.sound.rows) meter.show(last(tables.sound, LEVEL), last(tables.sound, LOW), last(tables.sound, HIGH), state?.threshold_dbfs);
  newest = header.origin;
  steps.append(tables.steps, newest);
  events.append(tables.events, newest);
  timeline.threshold = state?.threshold_dbfs;
  count(tables.steps);
}

function frame() {
  requestAnimationFrame(frame);
  const value = (column) => steps.newest(column);
  hero.show({ touch: value(TOUCH), roughness: value(ROUGHNESS), amplitude: value(AMPLITUDE), frequency: value(FREQUENCY) }, bar.silence > 0.4, ["silent", "ended"].includes(bar.state));
  const silence = bar.silence < 3600 ? bar.silence : 0;
  timeline.draw((since) => [steps.after(since), events.after(since)], newest + silence);
}

const feed = new Feed("live", {
  onMessage: show,
  onAnswer: ({ refused, command }) => {
    if (refused) bar.refuse(refused);
    if (command) bar.command = command;
  },
  onLost: (why) => bar.lost(why),
});
foldOnPhone($("no-reaction"));
const bar = new StateBar((request) => feed.send(request), { waiting: "Press “Use this microphone” below, on the device that listens." });
requestAnimationFrame(frame);
