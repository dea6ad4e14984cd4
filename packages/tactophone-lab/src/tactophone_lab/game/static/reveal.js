// The curtain is lifted: the stones, the path of the finger, and the signals of the round.

import { list, put, formatNumber } from "../static/text.js";
import { Timeline, TRUTH } from "../static/timeline.js";
import { lay, place } from "./stage.js";

const $ = (id) => document.getElementById(id);
const [, X, Y, FORCE, UNDER] = Array(5).keys(); // of a row of the track
let timeline = null;
let signals = null; // {columns, end} of the round on the screen
let shown = null; // {result, track} of the round on the screen

new ResizeObserver(drawStones).observe($("lifted"));

/** Show a finished round. */
export function reveal({ result, past, kept }, { steps, track }) {
  put($("verdict"), ["Neither was rough", "One of two is right", "Both are right"][result.correct]);
  put($("took"), `${formatNumber(result.duration, 0, "s")}${result.trainer ? ", with the trainer on: not scored" : ""}.${past.rounds > 1 ? ` So far ${past.right} of ${past.rounds} rounds right, median ${formatNumber(past.median_duration, 0, "s")}.` : ""}`);
  list($("score"), [
    ["strokes", formatNumber(result.strokes.reduce((a, b) => a + b))],
    ["press to sound", result.round_trip === null ? "–" : formatNumber(1000 * result.round_trip, 0, "ms")],
    ["false bumps", String(result.false_bumps)],
    ["dips", String(result.dips)],
    ["seed", String(result.seed)],
  ]);
  put($("kept"), kept);
  shown = { result, track: columns(track) };
  drawStones();
  $("lifted").ariaLabel = `The stones: ${result.order.join(", ")}`;
  drawSignals(columns(steps), columns(track));
  timeline.counted = `false bumps: ${result.false_bumps}, dips: ${result.dips}`;
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
  if (!timeline) {
    timeline = new Timeline($("round"), { fixed: true });
    setInterval(() => { if (document.body.dataset.screen === "reveal") drawRound(); }, 100);
  }
  steps[TRUTH] = Float64Array.from(truthAt(track, steps[0]));
  signals = { columns: steps, end: Math.max(steps[0].at(-1) ?? 0, track[0].at(-1) ?? 0) };
  drawRound();
}

function drawRound() {
  timeline.draw(() => [signals.columns, [[], []]], signals.end, Math.max(1, signals.end));
}

/** The truth, known at each move of the finger, at the given times. */
function truthAt(track, times) {
  let at = 0;
  return times.map((time) => {
    while (at + 1 < track[0].length && track[0][at + 1] <= time) at++;
    return track[UNDER][at] ?? 0;
  });
}

/** The result as a picture to share, or to keep where nothing can be shared. */
export async function saveCard() {
  const { order, choices, correct, duration, seed, false_bumps: bumps, dips } = shown.result;
  const canvas = Object.assign(document.createElement("canvas"), { width: 1000, height: 420 });
  const context = canvas.getContext("2d");
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  const write = (text, size, left, top, name = "ink") => {
    context.font = `600 ${size}px system-ui, sans-serif`;
    context.fillStyle = colour(name);
    context.fillText(text, left, top);
  };
  context.fillStyle = colour("panel");
  context.fillRect(0, 0, canvas.width, canvas.height);
  write(`The stone box: ${correct} of 2 rough stones found by touch`, 34, 50, 80);
  write(`in ${formatNumber(duration, 1)} s, seed ${seed}; false bumps: ${bumps}, dips: ${dips}`, 24, 50, 122, "soft");
  order.forEach((touch, k) => {
    context.fillStyle = colour(touch);
    context.beginPath();
    context.roundRect(50 + 184 * k, 160, 160, 130, 24);
    context.fill();
    write(touch, 24, 66 + 184 * k, 235, "panel");
    if (choices.includes(k)) write(touch === "rough" ? "✓ marked" : "✗ marked", 24, 60 + 184 * k, 330);
  });
  write("tactophone play: a telephone for touch", 22, 50, 390, "soft");
  const blob = await new Promise((done) => { canvas.toBlob(done); });
  const file = new File([blob], `stone-box-${seed}.png`, { type: "image/png" });
  if (navigator.userAgentData?.mobile && navigator.canShare?.({ files: [file] })) return navigator.share({ files: [file] }).catch(() => {});
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(file), download: file.name });
  link.click();
  URL.revokeObjectURL(link.href);
}
