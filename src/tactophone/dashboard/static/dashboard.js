// The operator's page: takes what the feed brings, draws it once for each picture of the screen.

import { Chart, line, stripes } from "./charts.js";
import { Controls } from "./controls.js";
import { dbfs, percent, put, showFaults, showLatency, showLink, tell } from "./figures.js";
import { Feed } from "./live.js";
import { Meter } from "./meter.js";
import { Track } from "./track.js";

const SOUND_SPAN = 5; // s
const BELIEF_SPAN = 10; // s
const SCOPE = { span: 0.1, step: 1 / 4000 }; // s; message.py sends 4 kHz
const REWOUND = 0.5; // s back, after which it is another recording or another run
const CLIPPED = 0.999;
const CALM = 250; // ms between pictures for who wants little motion
const TOUCHES = ["no contact", "smooth", "rough"];
// Columns of the tick track, after message.py's TICK_COLUMNS.
const [, NONE, SMOOTH, ROUGH, ROUGHNESS, LEVEL, AMPLITUDE, FREQUENCY, TOUCH, TRUTH] = Array(10).keys();

const $ = (id) => document.getElementById(id);
const ticks = new Track(10, 2200);
const sound = new Track(7, 600);
const scope = new Track(2, 2000);
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
        if (highs[k] < CLIPPED && lows[k] > -CLIPPED) return;
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
    label: (value) => tell(value),
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
  const chart = new Chart($(id), { span: BELIEF_SPAN, ...options });
  return () => {
    const all = ticks.after(now - BELIEF_SPAN);
    chart.draw([all[0], ...columns.map((column) => all[column])], now);
  };
}

function scopePicture() {
  const chart = new Chart($("scope"), {
    span: SCOPE.span,
    lines: [line("felt", { width: 1.5 })],
    y: () => [-1.15, 1.15],
    splits: () => [-1, 0, 1],
    label: (value) => tell(value),
    times: true,
    scale: 1000,
    over: (plot) => [1, -1].forEach((sign) => state && plot.rule(sign * state.ceiling, "warn")),
  });
  return () => chart.draw(scope.after(scope.newest(0) - SCOPE.span), scope.newest(0));
}

const pictures = [
  wave("contact-wave", "contact", 1),
  wave("air-wave", "air", 4),
  levels(),
  history("probabilities", [NONE, SMOOTH, ROUGH], {
    lines: [line("none", { dash: [4, 3] }), line("smooth"), line("rough")],
    y: () => [0, 1], splits: () => [0, 0.5, 1], label: (value) => tell(value, 1),
  }),
  history("touches", [TOUCH, TRUTH], {
    lines: [line("ink"), line("ink")].map((one) => ({ ...one, paths: () => null })),
    y: () => [0, 2], splits: () => [0.5, 1.5], label: (value) => (value > 1 ? "judged" : "truth"),
    over: stripes,
  }),
  history("roughness", [ROUGHNESS], {
    lines: [line("rough", { fill: true })],
    y: () => [0, 1], splits: () => [0, 0.5, 1], label: (value) => tell(value, 1), times: true,
  }),
  scopePicture(),
  history("amplitudes", [AMPLITUDE], {
    lines: [line("felt", { fill: true })],
    y: () => [0, 1], splits: () => [0, 0.5, 1], label: (value) => tell(value, 1),
    over: (plot) => state && plot.rule(state.ceiling, "warn"),
  }),
  history("frequencies", [FREQUENCY], {
    lines: [line("felt")],
    y: (plot, lowest, highest) => [0, Math.max(200, 1.1 * highest)], label: (value) => tell(value), times: true,
  }),
];

function take({ words, tables }) {
  alive = words.alive;
  if (words.waiting_for) return showLife(`waiting for “${words.waiting_for}”`);
  if (words.origin < now - REWOUND) [ticks, sound, scope].forEach((track) => track.clear());
  now = words.origin;
  ticks.append(tables.ticks, now);
  sound.append(tables.sound, now);
  appendScope(tables.scope);
  if (words.state) showWhole(words);
  showLife(alive ? "live" : words.age < 3600 ? `no sign of life for ${tell(words.age)} s` : "ended");
}

function appendScope({ rows, numbers }) {
  const times = new Float32Array(2 * rows);
  const begin = scope.newest(0) || 0;
  numbers.forEach((value, k) => times.set([(k + 1) * SCOPE.step, value], 2 * k));
  scope.append({ rows, columns: 2, numbers: times }, begin);
}

function showWhole({ state: told, counters, gauges }) {
  state = told;
  put($("run"), [state.source, state.link, state.output === "none" ? "no actuator" : state.output].filter(Boolean).join("  →  ") || state.role);
  document.title = `Tactophone ${state.role}`;
  controls.show(state, alive);
  showFaults($("faults"), state.faults);
  showLink($("link"), counters, gauges);
  showLatency({ stack: $("stack"), stages: $("stages"), total: $("total") }, gauges);
  put($("permit"), permit());
  $("permit").dataset.armed = state.armed && alive;
  put($("ceiling-now"), percent(state.ceiling));
  document.body.classList.toggle("mono", state.channels === 1);
}

function permit() {
  if (state.role === "replay") return "a replay: nothing is driven";
  if (!alive) return "muted: the run has ended";
  return state.armed ? "armed" : `muted: ${state.muted_because || "not armed"}`;
}

function showLife(text) {
  put($("life"), text);
  $("life").dataset.alive = alive;
  if (!alive && state) controls.show(state, false);
}

function showNow() {
  const touch = ticks.newest(TOUCH);
  put($("verdict"), Number.isNaN(touch) ? "–" : TOUCHES[touch]);
  $("verdict").dataset.touch = touch;
  meters.contact.show(sound.newest(3), sound.newest(1), sound.newest(2), state?.threshold_dbfs);
  meters.air.show(sound.newest(6), sound.newest(4), sound.newest(5));
  const amplitude = ticks.newest(AMPLITUDE);
  put($("amplitude"), percent(amplitude));
  put($("frequency"), amplitude > 0 ? tell(ticks.newest(FREQUENCY), 0, "Hz") : "–");
  $("levels").ariaLabel = `Contact ${dbfs(ticks.newest(LEVEL))}, air ${dbfs(sound.newest(6))}`;
}

let drawn = -CALM;
function picture(time) {
  requestAnimationFrame(picture);
  if (calm.matches && time - drawn < CALM) return;
  drawn = time;
  pictures.forEach((draw) => draw());
  showNow();
}

const feed = new Feed("live", {
  onMessage: take,
  onAnswer: ({ refused }) => controls.refuse(refused),
  onLost: (why) => { alive = false; showLife(why); },
});
const controls = new Controls((wish) => feed.send(wish));
requestAnimationFrame(picture);
