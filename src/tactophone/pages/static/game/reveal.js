// The curtain is lifted: the stones, the path of the finger, and the signals of the round.

import { Chart, line, stripes } from "../static/charts.js";
import { list, put, formatNumber } from "../static/figures.js";
import { lay, place } from "./stage.js";

const $ = (id) => document.getElementById(id);
const [, X, Y, FORCE, TRUTH] = Array(5).keys(); // of a row of the track
const [, , , , TOUCH, LEVEL, ROUGHNESS, , AMPLITUDE] = Array(10).keys(); // of a row of the steps
let span = 10;
let charts = null;
let shown = null; // {result, track} of the round on the screen

new ResizeObserver(drawStones).observe($("lifted"));

/** Show a finished round. */
export function reveal({ result, past, kept }, { steps, track }) {
  put($("verdict"), ["Neither was rough.", "One of two is right.", "Both are right."][result.correct]);
  list($("score"), [
    ["time", formatNumber(result.duration, 1, "s")],
    ["strokes", formatNumber(result.strokes.reduce((a, b) => a + b))],
    ["press to sound", result.round_trip === null ? "–" : formatNumber(1000 * result.round_trip, 0, "ms")],
    ["seed", String(result.seed)],
    ...(result.trainer ? [["trainer", "on, not scored"]] : []),
    ...(past.rounds ? [["so far", `${past.right} of ${past.rounds} right`], ["median time", formatNumber(past.median_duration, 1, "s")]] : []),
  ]);
  put($("kept"), kept);
  shown = { result, track: columns(track) };
  drawStones();
  $("lifted").ariaLabel = `The stones: ${result.order.join(", ")}`;
  drawSignals(columns(steps), columns(track));
  $("verdict").focus();
}

/** Draw stones and path in the box's present size: a phone may be turned. */
function drawStones() {
  if (!shown) return;
  lay($("lifted"), (slot, k) => dress(slot, k, shown.result));
  drawTrace(shown.track);
}

function dress(slot, k, { order, choices }) {
  slot.classList.add(order[k]);
  const chosen = choices.includes(k);
  slot.classList.toggle("chosen", chosen);
  const sign = chosen ? (order[k] === "rough" ? " ✓" : " ✗") : "";
  slot.append(Object.assign(document.createElement("span"), { textContent: `${order[k]}${sign}` }));
}

function columns({ rows, columns: count, numbers }) {
  return Array.from({ length: count }, (_, k) => Float64Array.from({ length: rows }, (__, row) => numbers[row * count + k]));
}

function drawTrace(track) {
  const canvas = $("trace");
  const stage = $("lifted");
  canvas.width = stage.clientWidth * devicePixelRatio;
  canvas.height = stage.clientHeight * devicePixelRatio;
  const context = canvas.getContext("2d");
  context.lineWidth = 1.2 * devicePixelRatio;
  context.strokeStyle = "#fff";
  context.globalAlpha = 0.75;
  context.beginPath();
  track[X].forEach((x, k) => {
    const [left, top] = place(stage, x, track[Y][k]);
    const pressed = track[FORCE][k] > 0 && k > 0 && track[FORCE][k - 1] > 0;
    context[pressed ? "lineTo" : "moveTo"](left * canvas.width, top * canvas.height);
  });
  context.stroke();
}

function drawSignals(steps, track) {
  charts ??= makeCharts();
  const end = Math.max(steps[0].at(-1) ?? 0, track[0].at(-1) ?? 0);
  span = Math.max(1, end);
  charts.touches.draw([steps[0], steps[TOUCH], truthAt(track, steps[0])], end);
  charts.roughness.draw([steps[0], steps[ROUGHNESS]], end);
  charts.level.draw([steps[0], steps[LEVEL]], end);
  charts.amplitude.draw([steps[0], steps[AMPLITUDE]], end);
}

/** The truth, known at each move of the finger, at the given times. */
function truthAt(track, times) {
  let at = 0;
  return times.map((time) => {
    while (at + 1 < track[0].length && track[0][at + 1] <= time) at++;
    return track[TRUTH][at] ?? 0;
  });
}

function makeCharts() {
  const chart = (id, options) => new Chart($(id), { span: () => span, ...options });
  return {
    touches: chart("round-touches", {
      lines: [line("ink"), line("ink")].map((entry) => ({ ...entry, paths: () => null })),
      y: () => [0, 2], splits: () => [0.5, 1.5], label: (value) => (value > 1 ? "model" : "truth"), over: stripes,
    }),
    roughness: chart("round-roughness", {
      lines: [line("rough", { fill: true })], y: () => [0, 1], splits: () => [0, 0.5, 1], label: (value) => formatNumber(value, 1),
    }),
    level: chart("round-level", {
      lines: [line("contact")], y: () => [-100, 0], splits: () => [-80, -60, -40, -20], label: (value) => formatNumber(value),
    }),
    amplitude: chart("round-amplitude", {
      lines: [line("vibration", { fill: true })], y: () => [0, 1], splits: () => [0, 0.5, 1], label: (value) => formatNumber(value, 1), times: true,
    }),
  };
}
