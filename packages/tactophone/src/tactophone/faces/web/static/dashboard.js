// The dashboard: charts, meters, link with loss and jitter, latency; receives the feed's messages, redraws each frame.

import { Chart, line } from "./charts.js";
import { Check } from "./check.js";
import { Controls } from "./controls.js";
import { Hero } from "./hero.js";
import { Feed } from "./feed.js";
import { FULL_SCALE, Meter } from "./meter.js";
import { Record } from "./record.js";
import { SpectrogramChart } from "./spectrogram.js";
import { StateBar } from "./statebar.js";
import { formatNumber, lines, list, milliseconds, percent, put, showFaults } from "./text.js";
import { AMPLITUDE, FREQUENCY, LONGEST, ROUGH, ROUGHNESS, SMOOTH, STEP_COLUMNS, Timeline, TOUCH, TOUCHES, TRUTH } from "./timeline.js";
import { broken, Track } from "./track.js";

const SOUND_SPAN = 5; // s
const LATENCY_SPAN = 60; // s
const PREDICTION_SPAN = 10; // s
const SCOPE = { span: 0.1, step: 1 / 4000 }; // s; feed.py sends 4 kHz
const CALM = 250; // ms between frames when the system asks for reduced motion
const IMMEDIATE = 0.025; // s: a hand does not notice less
const VIEW = "tactophone-view";
const LATENCY = "latency_"; // begins the name of each stage's gauge, and of the total's
const FINGER = Number(new URLSearchParams(location.search).get("finger") ?? 0);

const $ = (id) => document.getElementById(id);
const steps = new Track(STEP_COLUMNS, 110 * LONGEST);
const sound = new Track(7, 600);
const spectrum = new Track(17, 300);
const scope = new Track(2, 2000);
const events = new Track(2, 400);
const latency = new Track(2, 400);
const hero = new Hero($("hero"));
const timeline = new Timeline($("timeline"));
const calm = matchMedia("(prefers-reduced-motion: reduce)");
let state = null;
let alive = false;
let newest = 0; // stream time of the newest message
let now = 0; // stream time at the right edge, which moves on when nothing comes

const meters = { contact: new Meter($("contact-meter"), "Contact"), air: new Meter($("air-meter"), "Air") };

/** The greatest of 1, 2 and 5 times a power of ten that is not over a value. */
function round(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [5, 2, 1].find((digit) => digit * power <= value * (1 + 1e-9));
}

function wave(id, name, low) {
  const reach = ([, ...columns]) => Math.max(0.02, ...columns.map((column) => column.reduce((a, b) => Math.max(a, Math.abs(b)), 0)));
  let top = 0.02;
  const chart = new Chart($(id), {
    span: SOUND_SPAN,
    lines: [line(name, { width: 1 }), line(name, { width: 1 })],
    between: [2, 1],
    y: () => [-top, top],
    splits: () => [-round(top), 0, round(top)],
    label: (value) => formatNumber(value, top < 0.2 ? 2 : 1),
    times: true,
    over: (plot, [times, lows, highs]) => {
      times.forEach((time, k) => {
        if (highs[k] < FULL_SCALE && lows[k] > -FULL_SCALE) return;
        [[0.88 * top, top], [-top, -0.88 * top]].forEach((edge) => plot.block([time - 0.02, time + 0.01], edge, "warn"));
      });
    },
  });
  return () => {
    const columns = broken(sound.after(now - SOUND_SPAN));
    const shown = [columns[0], columns[low], columns[low + 1]];
    top = Math.max(reach(shown), 0.97 * top);
    chart.draw(shown, now);
  };
}

/** P(rough | contact): a gap where there is no contact. */
function probability() {
  const chart = new Chart($("probability"), {
    span: PREDICTION_SPAN, lines: [line("rough")], times: true,
    y: () => [0, 1], splits: () => [0, 0.5, 1], label: (value) => formatNumber(value, 1),
    over: (plot) => plot.rule(0.5, "soft"),
  });
  return () => {
    const rows = broken(steps.after(now - PREDICTION_SPAN));
    const share = (touch, k) => (touch > 0 ? rows[ROUGH][k] / (rows[SMOOTH][k] + rows[ROUGH][k]) : null);
    chart.draw([rows[0], Array.from(rows[TOUCH], share)], now);
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

/** End-to-end latency over the last minute: it comes with the state, five times a second. Hidden where nothing measures it. */
function latencyOverTime(id) {
  let top = 0.02;
  const part = $(id).closest(".over-time");
  const chart = new Chart($(id), {
    span: LATENCY_SPAN, lines: [line("ink")], times: true,
    y: () => [0, top], splits: () => [0, top / 2, top], label: (value) => formatNumber(1000 * value),
    over: (plot) => plot.rule(IMMEDIATE, "soft"),
  });
  return () => {
    const shown = latency.after(now - LATENCY_SPAN);
    part.hidden = Number.isNaN(latency.newest(0));
    top = 1.2 * Math.max(IMMEDIATE, ...shown[1]);
    chart.draw(shown, now);
  };
}

const spectrogram = new SpectrogramChart($("spectrogram"), SOUND_SPAN);
const charts = [latencyOverTime("health-latency"), latencyOverTime("link-latency"), wave("contact-wave", "contact", 1), () => spectrogram.draw(spectrum.after(now - SOUND_SPAN), now), wave("air-wave", "air", 4), probability(), scopeChart()];

function onMessage({ header, tables }) {
  alive = header.alive;
  bar.take({ ...header, ...header.state }, tables.steps?.rows || tables.sound?.rows);
  if (header.waiting_for) return;
  newest = header.origin;
  steps.append(tables.steps, newest);
  sound.append(tables.sound, newest);
  spectrum.append(tables.spectrum, newest);
  spectrogram.bandsHz = header.bands_hz ?? spectrogram.bandsHz;
  events.append(tables.events, newest);
  appendScope(tables.scope);
  if (header.state) showState(header);
  if (Number.isFinite(header.gauges?.latency_total ?? NaN)) latency.append({ rows: 1, columns: 2, numbers: [0, header.gauges.latency_total] }, newest);
  if ("whole" in header) record.whole = header.whole;
  if (state?.role === "replay") timeline.transport(state, newest, (request) => feed.send(request));
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

/** The scope has no times of its own: its samples follow those before. */
function appendScope({ rows, numbers }) {
  const times = new Float32Array(2 * rows);
  numbers.forEach((value, k) => times.set([(k + 1 - rows) * SCOPE.step, value], 2 * k));
  scope.append({ rows, columns: 2, numbers: times }, (scope.newest(0) || 0) + rows * SCOPE.step);
}

function showState({ state: newest, counters, gauges }) {
  state = newest;
  put($("run"), [state.source, state.link, state.output === "none" ? "no actuator" : state.output].filter(Boolean).join("  →  ") || state.role);
  document.title = `Tactophone ${state.role}`;
  controls.show(state, alive);
  showFaults($("faults"), state.faults);
  showLink($("link"), counters, gauges);
  showHealth($("health"), state, counters, gauges);
  showLatency({ stack: $("stack"), stages: $("stages"), total: $("total") }, gauges);
  timeline.threshold = state.threshold_dbfs;
  document.body.classList.toggle("mono", state.channels === 1);
  document.body.dataset.role = state.role; // style.css leaves out what a role does not have
}

/** Statistics of the link. */
function showLink(node, counters, gauges) {
  const total = counters.packets_received + counters.packets_lost;
  const warn = (count) => (count > 0.01 * total ? "warn" : "");
  list(node, [
    ["received", formatNumber(counters.packets_received), "authentic packets received"],
    ["lost", `${formatNumber(counters.packets_lost)} · ${percent(gauges.loss_ratio ?? ratio(counters.packets_lost, total), 1)}`,
      "packets never received, or too late; share of the last seconds", warn(counters.packets_lost)],
    ["recovered", formatNumber(counters.packets_recovered), "lost packets recovered from redundancy in the next ones"],
    ["concealed", formatNumber(counters.packets_concealed), "lost packets whose sound was concealed", warn(counters.packets_concealed)],
    ["late", formatNumber(counters.packets_late), "packets received after their place was filled, and dropped", warn(counters.packets_late)],
    ["duplicated", formatNumber(counters.packets_duplicated), "packets received more than once"],
    ["rejected", formatNumber(counters.packets_rejected), "datagrams that failed authentication", warn(counters.packets_rejected)],
    ["skipped", formatNumber(counters.packets_skipped), "packets too old for a prediction, after a stall"],
    ["jitter", milliseconds(gauges.jitter, 2), "RFC 3550"],
    ["playout delay", milliseconds(gauges.playout_delay), "time that sound waits for late packets"],
    ["clock skew", formatNumber(gauges.clock_skew_ppm, 0, "ppm"), "how much faster the peer's sound clock runs"],
    ["bitrate", formatNumber(gauges.bitrate_bps === null ? null : gauges.bitrate_bps / 1000, 0, "kbit/s"), "all headers included"],
    ["round trip", milliseconds(gauges.round_trip), "to the peer and back"],
    ["redundancy", formatNumber(gauges.redundancy), "earlier packets carried in each packet"],
  ]);
}

/** Link, latency and device as sentences. */
function showHealth(node, { link, output, role }, counters, gauges) {
  const total = counters.packets_received + counters.packets_lost;
  const loss = gauges.loss_ratio ?? ratio(counters.packets_lost, total);
  const word = loss > 0.05 ? "bad" : loss > 0.01 ? "fair" : "good";
  const jitter = gauges.jitter === null ? "" : `, ${milliseconds(gauges.jitter)} jitter`;
  const late = gauges.latency_total > IMMEDIATE;
  const sentences = [
    [total ? `Link ${word}: ${percent(loss, 1)} lost lately, ${formatNumber(counters.packets_lost)} of ${formatNumber(total)} in all${jitter}.` : `Link: ${link === "replay" ? "none, this is a recording" : link || "none, this run is local"}.`, total ? word : "unknown"],
    [gauges.latency_total === null ? `Latency: not measured ${link === "replay" ? "in a replay" : "yet"}.` : `Latency ${late ? "fair" : "good"}: ${milliseconds(gauges.latency_total)} from touch to vibration; felt as immediate under ${milliseconds(IMMEDIATE, 0)}.`, gauges.latency_total === null ? "unknown" : late ? "fair" : "good"],
    ...(role === "robot" ? [] : [[`Actuator: ${!output || output === "none" ? "none; press Feel it here to feel this run on this device" : output}.`, !output || output === "none" ? "unknown" : "good"]]),
    ...(!output || output === "none" ? [] : [[counters.xruns ? `Sound device: ${formatNumber(counters.xruns)} ${counters.xruns === 1 ? "period" : "periods"} lost.` : "Sound device: no period lost.", counters.xruns ? "fair" : "good"]]),
  ];
  lines(node, sentences);
}

/** The latency budget: a bar of stages, its key, and the end-to-end latency, which is measured independently. */
function showLatency({ stack, stages, total }, gauges) {
  // The gauges come in the order of the stages, from microphone to actuator.
  const budget = Object.entries(gauges)
    .filter(([name]) => name.startsWith(LATENCY) && name !== "latency_total")
    .map(([name, seconds]) => [name.slice(LATENCY.length), seconds]);
  const known = budget.filter(([, seconds]) => seconds !== null);
  const sum = known.reduce((subtotal, [, seconds]) => subtotal + seconds, 0);
  put(total, gauges.latency_total === null ? "not measured yet" : `${milliseconds(gauges.latency_total)} end to end`);
  if (stack.children.length !== budget.length) {
    stack.replaceChildren(...budget.map(([stage]) => Object.assign(document.createElement("i"), { className: stage })));
  }
  budget.forEach(([, seconds], k) => { stack.children[k].style.flexGrow = sum ? (seconds ?? 0) / sum : 0; });
  stack.ariaLabel = known.length
    ? `Latency budget: ${known.map(([stage, seconds]) => `${stage} ${milliseconds(seconds)}`).join(", ")}`
    : "Latency budget: not measured yet";
  list(stages, [
    ...budget.map(([stage, seconds]) => [stage, milliseconds(seconds, 2), "median", stage]),
    ["sum of stages", known.length ? milliseconds(sum, 2) : "–", "compare with the end-to-end latency", "sum"],
  ]);
}

function ratio(part, whole) {
  return whole ? part / whole : null;
}

function showNow() {
  const value = (column) => steps.newest(column);
  hero.show({ touch: value(TOUCH), roughness: value(ROUGHNESS), amplitude: value(AMPLITUDE), frequency: value(FREQUENCY) }, bar.silence > 0.4, ["silent", "ended"].includes(bar.state));
  put($("next"), nextAction(value(TOUCH)));
  const [contact, air] = [1, 4].map((low) => [sound.newest(low + 2), sound.newest(low), sound.newest(low + 1)]);
  meters.contact.show(...contact, state?.threshold_dbfs);
  meters.air.show(...air);
  check.show(alive ? state : null, [contact, air], controls.local);
}

/** What a person can do next, said where there is little to see. */
function nextAction(touch) {
  if (state?.role === "robot") return "";
  if (Number.isNaN(touch)) return "Waiting for sound: start the robot's side, then stroke something.";
  if (bar.state === "muted") return "Detected, but not felt: press Resume to vibrate.";
  if (touch !== 0 || state?.role === "replay") return "";
  // What it really touches is known of a simulated finger alone, which strokes by itself.
  return steps.newest(TRUTH) >= 0 ? "The simulated finger strokes by itself, and lifts in between." : "Nothing is touched: stroke something.";
}

function showView(view) {
  const radio = document.querySelector(`#views [value="${view}"]`);
  if (!radio) return;
  radio.checked = true;
  $("desk").dataset.view = view;
  localStorage.setItem(VIEW, view);
}
$("views").addEventListener("change", ({ target }) => showView(target.value));
showView(localStorage.getItem(VIEW));

let drawn = -CALM;
function frame(time) {
  requestAnimationFrame(frame);
  if (calm.matches && time - drawn < CALM) return;
  drawn = time;
  const still = state?.paused || bar.silence > 3600; // nothing is missing from a replay that was paused
  now = newest + (still ? 0 : bar.silence);
  charts.forEach((draw) => draw());
  timeline.draw((since) => [steps.after(since), events.after(since)], now);
  showNow();
}

const feed = new Feed(FINGER ? `live?finger=${FINGER}` : "live", {
  onMessage,
  onAnswer: (answer) => {
    if ("recording" in answer) record.show(answer.recording, answer.now);
    if (answer.command) {
      bar.command = answer.command;
      controls.local = true; // only a page on the run's machine is told
    }
    if (answer.refused) controls.refuse(answer.refused);
    if (answer.refused) bar.refuse(answer.refused);
  },
  onLost: (why) => { alive = false; bar.lost(why); },
});
const bar = new StateBar((request) => feed.send(request));
const controls = new Controls((request) => feed.send(request));
const check = new Check();
const record = new Record((request) => feed.send(request));
requestAnimationFrame(frame);
