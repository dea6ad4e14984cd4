// The operator's page: receives the feed's messages and redraws once per screen frame.

import { Chart, line, stripes } from "./charts.js";
import { Controls } from "./controls.js";
import { FULL_SCALE, dbfs, percent, put, showFaults, showLatency, showLink, formatNumber } from "./figures.js";
import { Feed } from "./live.js";
import { Meter } from "./meter.js";
import { Record } from "./record.js";
import { StateBar } from "./statebar.js";
import { Track } from "./track.js";

const SOUND_SPAN = 5; // s
const PREDICTION_SPAN = 10; // s
const SCOPE = { span: 0.1, step: 1 / 4000 }; // s; message.py sends 4 kHz
const REWOUND = 0.5; // s; a jump back by more means another recording or run
const CALM = 250; // ms between frames when the system asks for reduced motion
const TOUCHES = ["no contact", "smooth", "rough"];
// Columns of the table of steps: time, then STEP_COLUMNS of message.py.
const [, NONE, SMOOTH, ROUGH, TOUCH, LEVEL, ROUGHNESS, FREQUENCY, AMPLITUDE, TRUTH] = Array(10).keys();

// Kinds of touch events, counted from 1: EVENT_KINDS of types.py.
const EVENTS = ["", "contact", "tap", "knock in the air", "stroke", "slip", "lift-off"];
const CONTACT_BEGAN = 1; // reported before it is known what it was: drawn, but not named

const FINGER = Number(new URLSearchParams(location.search).get("finger") ?? 0);

const $ = (id) => document.getElementById(id);
const steps = new Track(10, 2200);
const sound = new Track(7, 600);
const scope = new Track(2, 2000);
const events = new Track(2, 400);
const calm = matchMedia("(prefers-reduced-motion: reduce)");
let state = null;
let alive = false;
let now = 0; // stream time at the right edge

const meters = { contact: new Meter($("contact-meter"), "Contact"), air: new Meter($("air-meter"), "Air") };

function wave(id, name, low) {
  const reach = ([, ...columns]) => Math.max(0.01, ...columns.map((column) => column.reduce((a, b) => Math.max(a, Math.abs(b)), 0)));
  let top = 0.01;
  const chart = new Chart($(id), {
    span: SOUND_SPAN,
    lines: [line(name, { width: 1 }), line(name, { width: 1 })],
    between: [2, 1],
    y: () => [-top, top],
    splits: () => [-top / 2, 0, top / 2],
    label: (value) => (value ? "" : "0"),
    over: (plot, [times, lows, highs]) => {
      times.forEach((time, k) => {
        if (highs[k] < FULL_SCALE && lows[k] > -FULL_SCALE) return;
        [[0.88 * top, top], [-top, -0.88 * top]].forEach((edge) => plot.block([time - 0.02, time + 0.01], edge, "warn"));
      });
    },
  });
  return () => {
    const columns = sound.after(now - SOUND_SPAN);
    const shown = [columns[0], columns[low], columns[low + 1]];
    top = Math.max(reach(shown), 0.97 * top);
    chart.draw(shown, now);
  };
}

function levels() {
  const chart = new Chart($("levels"), {
    span: SOUND_SPAN,
    lines: [line("contact"), line("air", { dash: [6, 2] })],
    y: () => [-100, 0],
    splits: () => [-80, -60, -40, -20, 0],
    label: (value) => formatNumber(value),
    times: true,
    over: (plot) => {
      if (state?.threshold_dbfs !== null) plot.rule(state?.threshold_dbfs, "ink", [5, 3]);
      if (state?.noise_floor_dbfs !== null) plot.rule(state?.noise_floor_dbfs, "soft", [1, 3]);
    },
  });
  return () => {
    const columns = sound.after(now - SOUND_SPAN);
    chart.draw([columns[0], columns[3], columns[6]], now);
  };
}

function history(id, columns, options) {
  const chart = new Chart($(id), { span: PREDICTION_SPAN, ...options });
  return () => {
    const all = steps.after(now - PREDICTION_SPAN);
    chart.draw([all[0], ...columns.map((column) => all[column])], now);
  };
}

function scopeChart() {
  const chart = new Chart($("scope"), {
    span: SCOPE.span,
    lines: [line("vibration", { width: 1.5 })],
    y: () => [-1.15, 1.15],
    splits: () => [-1, 0, 1],
    label: (value) => formatNumber(value),
    times: true,
    scale: 1000,
    over: (plot) => [1, -1].forEach((sign) => state && plot.rule(sign * state.ceiling, "warn")),
  });
  return () => chart.draw(scope.after(scope.newest(0) - SCOPE.span), scope.newest(0));
}

const charts = [
  wave("contact-wave", "contact", 1),
  wave("air-wave", "air", 4),
  levels(),
  history("probabilities", [NONE, SMOOTH, ROUGH], {
    lines: [line("none", { dash: [4, 3] }), line("smooth"), line("rough")],
    y: () => [0, 1], splits: () => [0, 0.5, 1], label: (value) => formatNumber(value, 1),
  }),
  history("touches", [TOUCH, TRUTH], {
    lines: [line("ink"), line("ink")].map((entry) => ({ ...entry, paths: () => null })),
    y: () => [0, 2], splits: () => [0.5, 1.5], label: (value) => (value > 1 ? "model" : "label"),
    over: (plot, columns) => {
      stripes(plot, columns);
      plot.ticks(events.after(now - PREDICTION_SPAN)[0], "ink");
    },
  }),
  history("roughness", [ROUGHNESS], {
    lines: [line("rough", { fill: true })],
    y: () => [0, 1], splits: () => [0, 0.5, 1], label: (value) => formatNumber(value, 1), times: true,
  }),
  scopeChart(),
  history("amplitudes", [AMPLITUDE], {
    lines: [line("vibration", { fill: true })],
    y: () => [0, 1], splits: () => [0, 0.5, 1], label: (value) => formatNumber(value, 1),
    over: (plot) => state && plot.rule(state.ceiling, "warn"),
  }),
  history("frequencies", [FREQUENCY], {
    lines: [line("vibration")],
    y: (plot, lowest, highest) => [0, Math.max(200, 1.1 * highest)], label: (value) => formatNumber(value), times: true,
  }),
];

function onMessage({ header, tables }) {
  alive = header.alive;
  bar.take({ ...header, ...header.state }, tables.steps?.rows || tables.sound?.rows);
  if (header.waiting_for) return;
  if (header.origin < now - REWOUND) [steps, sound, scope, events].forEach((track) => track.clear());
  now = header.origin;
  steps.append(tables.steps, now);
  sound.append(tables.sound, now);
  events.append(tables.events, now);
  appendScope(tables.scope);
  if (header.state) showState(header);
  if (state?.fingers?.[0].name) showHand(state.fingers, header.hand ?? []);
  if (!alive && state) controls.show(state, false);
}

// The fingers of a hand: what each does now, and a link to its page.
function showHand(fingers, hand) {
  const place = $("hand");
  place.hidden = !fingers.length;
  const feel = $("feel");
  feel.dataset.label = `Feel the ${(fingers[FINGER] ?? fingers[0]).name} here`;
  if (feel.ariaPressed !== "true") put(feel, feel.dataset.label);
  while (place.children.length < fingers.length) {
    const link = document.createElement("a");
    link.href = `?finger=${place.children.length}`;
    link.append(document.createElement("i"), document.createElement("b"), document.createElement("small"));
    place.append(link);
  }
  fingers.forEach((finger, k) => {
    const link = place.children[k];
    const [bar, name, touch] = link.children;
    const [kind, amplitude] = hand[k] ?? [0, 0];
    link.dataset.touch = kind;
    link.dataset.armed = finger.armed || state.role !== "operator";
    if (k === FINGER) link.setAttribute("aria-current", "true");
    bar.style.setProperty("--amplitude", amplitude);
    put(name, finger.name);
    put(touch, link.dataset.armed === "true" ? TOUCHES[kind] : "muted");
  });
}

function appendScope({ rows, numbers }) {
  const times = new Float32Array(2 * rows);
  const begin = scope.newest(0) || 0;
  numbers.forEach((value, k) => times.set([(k + 1) * SCOPE.step, value], 2 * k));
  scope.append({ rows, columns: 2, numbers: times }, begin);
}

function showState({ state: newest, counters, gauges }) {
  state = newest;
  put($("run"), [state.source, state.link, state.output === "none" ? "no actuator" : state.output].filter(Boolean).join("  →  ") || state.role);
  document.title = `Tactophone ${state.role}`;
  controls.show(state, alive);
  showFaults($("faults"), state.faults);
  showLink($("link"), counters, gauges);
  showLatency({ stack: $("stack"), stages: $("stages"), total: $("total") }, gauges);
  put($("ceiling-now"), percent(state.ceiling));
  document.body.classList.toggle("mono", state.channels === 1);
}

function showNow() {
  const touch = steps.newest(TOUCH);
  put($("decision"), Number.isNaN(touch) ? "–" : TOUCHES[touch]);
  $("decision").dataset.touch = touch;
  showEvents();
  meters.contact.show(sound.newest(3), sound.newest(1), sound.newest(2), state?.threshold_dbfs);
  meters.air.show(sound.newest(6), sound.newest(4), sound.newest(5));
  const amplitude = steps.newest(AMPLITUDE);
  put($("amplitude"), percent(amplitude));
  put($("frequency"), amplitude > 0 ? formatNumber(steps.newest(FREQUENCY), 0, "Hz") : "–");
  $("levels").ariaLabel = `Contact ${dbfs(steps.newest(LEVEL))}, air ${dbfs(sound.newest(6))}`;
}

/** The newest three touch events, newest first; nothing on a run without any. */
function showEvents() {
  const [times, kinds] = events.after(now - PREDICTION_SPAN);
  const named = Array.from(kinds, (kind, k) => [EVENTS[kind], now - times[k], kind]).filter(([, , kind]) => kind !== CONTACT_BEGAN);
  $("events").hidden = Number.isNaN(events.newest(0));
  put($("events"), named.slice(-3).reverse().map(([name, age]) => `${name} ${formatNumber(age, 0)} s ago`).join(", ") || "no touch event in the last 10 s");
}

let drawn = -CALM;
function frame(time) {
  requestAnimationFrame(frame);
  if (calm.matches && time - drawn < CALM) return;
  drawn = time;
  charts.forEach((draw) => draw());
  showNow();
}

const feed = new Feed(FINGER ? `live?finger=${FINGER}` : "live", {
  onMessage,
  onAnswer: (answer) => {
    if ("recording" in answer) record.show(answer.recording);
    if (answer.command) bar.command = answer.command;
    if (answer.refused) controls.refuse(answer.refused);
    if (answer.refused) bar.refuse(answer.refused);
  },
  onLost: (why) => { alive = false; bar.lost(why); },
});
const bar = new StateBar((request) => feed.send(request));
const controls = new Controls((request) => feed.send(request));
const record = new Record((request) => feed.send(request));
requestAnimationFrame(frame);
