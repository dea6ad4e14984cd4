// Try it: the microphone of this device, what the run detects, and a task: something smooth, then something rough.

import { dbfs, formatNumber, percent, put, showFaults } from "./figures.js";
import { Feed } from "./live.js";
import { Meter } from "./meter.js";
import { Microphone } from "./microphone.js";
import { StateBar } from "./statebar.js";

const $ = (id) => document.getElementById(id);
const TOUCHES = ["no contact", "smooth", "rough"];
const SMOOTH = 1;
const ROUGH = 2;
const HELD = 30; // steps, 0.3 s in all: a stroke, not a touch in passing
// Columns of the table of steps and of sound: message.py.
const [, , , , TOUCH, , ROUGHNESS, , AMPLITUDE] = Array(9).keys();
const [, LOW, HIGH, LEVEL] = Array(4).keys();

const meter = new Meter($("microphone-meter"), "Level");
const strokes = { [SMOOTH]: 0, [ROUGH]: 0 };
let state = null;

const microphone = new Microphone({
  onState: (text, live) => {
    put($("listen-state"), text);
    $("listen").ariaPressed = live;
    put($("listen"), live ? "Stop this microphone" : "Use this microphone");
  },
});
$("listen").addEventListener("click", () => (microphone.on ? microphone.stop() : microphone.start()));
$("threshold").addEventListener("input", ({ target }) => {
  put($("threshold-now"), dbfs(target.valueAsNumber));
  feed.send({ action: "threshold_dbfs", value: target.valueAsNumber });
});

function last({ rows, columns, numbers }, column) {
  return rows ? numbers[(rows - 1) * columns + column] : NaN;
}

function count({ rows, columns, numbers }) {
  for (let row = 0; row < rows; row++) {
    const touch = numbers[row * columns + TOUCH];
    if (touch in strokes && (touch === SMOOTH || strokes[SMOOTH] >= HELD)) strokes[touch]++;
  }
  const done = strokes[SMOOTH] >= HELD;
  const task = !done ? "Stroke something smooth: a glass, a glossy table."
    : strokes[ROUGH] < HELD ? "Now something rough: a brick, a file, coarse cloth."
      : "Both found. Try whatever is at hand.";
  put($("task"), task);
}

function show({ header, tables }) {
  bar.take({ ...header, ...header.state }, tables.steps?.rows || tables.sound?.rows);
  if (header.waiting_for) return;
  state = header.state ?? state;
  if (header.state) {
    showFaults($("faults"), state.faults);
    $("listen-panel").hidden = !["browser", "microphone", ""].includes(state.source);
    const held = document.activeElement === $("threshold");
    if (!held && Number.isFinite(state.threshold_dbfs)) $("threshold").value = state.threshold_dbfs;
    put($("threshold-now"), dbfs(held ? $("threshold").valueAsNumber : state.threshold_dbfs));
    put($("floor"), state.noise_floor_dbfs === null ? "" : `Noise floor ${dbfs(state.noise_floor_dbfs)}: set the threshold some dB above.`);
  }
  if (tables.sound.rows) meter.show(last(tables.sound, LEVEL), last(tables.sound, LOW), last(tables.sound, HIGH), state?.threshold_dbfs);
  if (!tables.steps.rows) return;
  const touch = last(tables.steps, TOUCH);
  put($("decision"), TOUCHES[touch]);
  $("decision").dataset.touch = touch;
  put($("roughness-now"), touch ? formatNumber(last(tables.steps, ROUGHNESS), 2) : "–");
  put($("amplitude"), percent(last(tables.steps, AMPLITUDE)));
  count(tables.steps);
}

const feed = new Feed("live", {
  onMessage: show,
  onAnswer: ({ refused, command }) => {
    if (refused) bar.refuse(refused);
    if (command) bar.command = command;
  },
  onLost: (why) => bar.lost(why),
});
const bar = new StateBar((request) => feed.send(request));
