// The touch timeline: sound, contact, roughness in the colours of the classes, the truth where it is known, and events.

import { Chart, line } from "./charts.js";
import { dbfs, formatNumber, percent, put } from "./text.js";
import { GAP, gaps, pieces } from "./track.js";

/** Columns of the table of steps: time, then STEP_COLUMNS of feed.py. */
export const [TIME, NONE, SMOOTH, ROUGH, TOUCH, LEVEL, ROUGHNESS, FREQUENCY, AMPLITUDE, UNKNOWN, TRUTH] = Array(11).keys();
export const STEP_COLUMNS = TRUTH + 1;
export const TOUCHES = ["no contact", "smooth", "rough"];
export const LONGEST = 20; // s
const SPANS = [1, 2, 5, 10, LONGEST]; // s
const CLASSES = ["none", "smooth", "rough"];
// Kinds of touch events, counted from 1: EVENT_KINDS of types.py. The first is drawn, but not named.
const EVENTS = ["", "", "tap", "knock in the air", "stroke", "slip", "lift-off"];
const LOWEST = -100; // dBFS
const place = (level) => 1.15 + 0.85 * Math.min(1, Math.max(0, 1 - level / LOWEST)); // sound above, roughness below

/** Call `each(from, to, value)` for runs of equal values; rows `from` up to and with `to`. */
function runs(values, each) {
  for (let k = 0, from = 0; k < values.length; k++) {
    if (k + 1 < values.length && values[k + 1] === values[from]) continue;
    each(from, Math.min(k + 1, values.length - 1), values[from]);
    from = k + 1;
  }
}

/** How often smooth was rendered as rough, and rough interrupted within one touch, where the truth is known. */
function faults(rows) {
  let [bumps, dips, known] = [0, 0, false];
  runs(rows[TRUTH] ?? [], (from, to, truth) => {
    let onsets = 0;
    for (let k = from; k < to; k++) onsets += rows[TOUCH][k] === 2 && (k === from || rows[TOUCH][k - 1] !== 2);
    if (truth === 1) bumps += onsets;
    if (truth === 2) dips += Math.max(0, onsets - 1);
    known ||= truth > 0;
  });
  return known ? `false bumps: ${bumps}, dips: ${dips}` : "";
}

export class Timeline {
  #chart;
  #node;
  #readout;
  #pause;
  #span = 10;
  #end = 0;
  #rows = [];
  #events = [[], []];
  #frozen = null;
  #transport = null;
  #pointed = null; // share of the width, of the cursor

  /** `node` is filled; `hint` is said while nothing is pointed at; a `fixed` timeline shows what it is given, whole. */
  constructor(node, { fixed = false, hint = "Point at it to read values." } = {}) {
    this.#node = node;
    this.hint = hint;
    this.counted = null; // a server's count of bumps and dips, in place of ours
    this.threshold = null;
    node.innerHTML = "<div class=tools><p class=key><b class=sound title='Level over the contact threshold, in dBFS'>sound</b><b class=ground>contact</b><b class=smooth title='Roughness, from 0'>smooth</b><b class=rough title='to 1'>rough</b><b class=truth title='Thin strip: what was really touched, where it is known' hidden>label</b></p><span class=buttons></span></div>"
      + "<div class='chart touch' role=img tabindex=0></div><p class='hint below'><span class=readout role=status></span><span class=counts title='False bumps: smooth rendered as rough. Dips: rough interrupted within one touch.'></span></p>";
    this.#readout = node.querySelector(".readout");
    if (!fixed) this.#addTools(node.querySelector(".buttons"));
    const plot = node.querySelector(".touch");
    plot.ariaLabel = "Touch timeline: sound level above, roughness from 0 smooth to 1 rough below. Arrow keys read its values.";
    this.#chart = new Chart(plot, {
      span: () => this.#span,
      lines: [{ ...line("ink"), paths: () => null }],
      y: () => [-0.06, 2.05],
      splits: () => [0, 0.45, 0.9, place(-80), place(-40), 2],
      label: (value) => (value <= 1 ? formatNumber(value / 0.9, 1) : formatNumber(LOWEST * (1 - (value - 1.15) / 0.85))),
      times: true,
      over: (chart) => this.#over(chart),
    });
    const box = () => plot.querySelector(".u-over").getBoundingClientRect();
    const point = (share) => { this.#pointed = share === null ? null : Math.min(1, Math.max(0, share)); };
    plot.addEventListener("pointermove", ({ clientX }) => point((clientX - box().left) / box().width));
    for (const end of ["pointerleave", "blur"]) plot.addEventListener(end, () => point(null));
    plot.addEventListener("keydown", ({ key }) => {
      if (key === "ArrowLeft" || key === "ArrowRight") point((this.#pointed ?? 1) + (key === "ArrowLeft" ? -0.01 : 0.01));
    });
  }

  /** `rows(since)` returns columns of steps, and of events, up to `end`. */
  draw(rows, end, span = this.#span) {
    this.#span = span;
    const { rows: shown, end: last } = this.#frozen ?? { rows, end };
    [this.#rows, this.#events] = shown(last - this.#span);
    this.#end = last;
    this.source = [rows, end];
    this.#chart.draw([this.#rows[TIME], this.#rows[TIME]], last);
    put(this.#readout, this.#words());
    put(this.#node.querySelector(".counts"), this.counted ?? faults(this.#rows));
    this.#node.querySelector(".truth").hidden = !(this.#rows[TRUTH] ?? []).some((truth) => truth >= 0);
  }

  /** The transport of a replay: play, pause and a slider over the whole recording, which `send` asks for. */
  transport({ duration, paused }, position, send) {
    if (!duration) return;
    if (!this.#transport) {
      const made = (tag, properties) => Object.assign(document.createElement(tag), properties);
      const play = made("button", { type: "button", id: "replay-pause" });
      const slider = made("input", { type: "range", id: "replay-position", min: 0, step: 0.05, ariaLabel: "Position in the recording" });
      const words = made("output", { id: "replay-time" });
      play.addEventListener("click", () => send({ action: "pause", value: play.ariaPressed === "true" ? 0 : 1 }));
      slider.addEventListener("change", () => send({ action: "seek", value: Math.min(slider.valueAsNumber, this.#transport.duration) }));
      const row = made("div", { className: "transport" });
      row.append(play, slider, words);
      this.#pause.hidden = true;
      play.setAttribute("aria-keyshortcuts", "p");
      this.#node.append(row);
      this.#transport = { play, slider, words };
    }
    const { play, slider, words } = this.#transport;
    this.#transport.duration = duration;
    slider.max = duration;
    if (document.activeElement !== slider || !slider.matches(":active")) slider.value = position;
    play.ariaPressed = paused;
    put(play, paused ? "Play" : "Pause");
    const clock = (time) => `${Math.floor(time / 60)}:${String(Math.floor(time % 60)).padStart(2, "0")}`;
    put(words, `${clock(Math.min(position, duration))} / ${clock(duration)}`);
  }

  #addTools(tools) {
    const button = (text, label, act) => {
      const made = Object.assign(document.createElement("button"), { type: "button", className: "quiet", textContent: text, ariaLabel: label });
      made.addEventListener("click", act);
      tools.append(made);
      return made;
    };
    this.#pause = button("Pause", "Pause the timeline", () => this.#toggle());
    this.#pause.setAttribute("aria-keyshortcuts", "p");
    button("−", "Show more time", () => this.#zoom(1));
    button("+", "Show less time", () => this.#zoom(-1));
    addEventListener("keydown", (event) => {
      if (event.target.closest?.("input, select") || event.ctrlKey || event.metaKey) return;
      ({ p: () => (this.#transport ? this.#transport.play.click() : this.#toggle()), "+": () => this.#zoom(-1), "-": () => this.#zoom(1) })[event.key.toLowerCase()]?.();
    });
  }

  #zoom(step) {
    this.#span = SPANS[Math.min(SPANS.length - 1, Math.max(0, SPANS.indexOf(this.#span) + step))];
  }

  #toggle() {
    if (this.#frozen) this.#frozen = null;
    else if (this.source) {
      const [rows, end] = this.source;
      const kept = rows(end - LONGEST).map((columns) => columns.map((column) => column.slice()));
      const from = (columns, since) => {
        const at = columns[0].findIndex((time) => time >= since);
        return columns.map((column) => (at < 0 ? [] : column.subarray(at)));
      };
      this.#frozen = { end, rows: (since) => kept.map((columns) => from(columns, since)) };
    }
    this.#pause.ariaPressed = Boolean(this.#frozen);
    put(this.#pause, this.#frozen ? "Go on" : "Pause");
  }

  #over(chart) {
    if (!this.#rows.length) return;
    for (const [from, to] of pieces(this.#rows[TIME])) this.#piece(chart, this.#rows.map((column) => column.subarray(from, to)));
    for (const gap of gaps(this.#rows[TIME], this.#end)) chart.hatch(gap, "no data");
    if (Number.isFinite(this.threshold)) chart.rule(place(this.threshold), "ink", [5, 3]);
    const [times, kinds] = this.#events;
    times.forEach((at, k) => chart.mark(at, EVENTS[kinds[k]], k ? at - times[k - 1] : Infinity));
    if (this.#pointed !== null) chart.mark(this.#end - (1 - this.#pointed) * this.#span, "", 0);
  }

  /** Rows that follow each other without a gap. */
  #piece(chart, rows) {
    const time = rows[TIME];
    runs(rows[TOUCH], (from, to, touch) => touch > 0 && chart.block([time[from], time[to]], [0, 2.05], "contact", 0.1));
    const quiet = Number.isFinite(this.threshold) ? Math.max(LOWEST, this.threshold) : LOWEST;
    chart.area(time, rows[LEVEL], (level) => place(Math.max(quiet, level)), place(quiet), "contact", 0.6);
    runs(rows[TOUCH], (from, to, touch) => {
      if (touch > 0) chart.area(time.subarray(from, to + 1), rows[ROUGHNESS].subarray(from, to + 1), (value) => 0.9 * Math.max(0.04, value), 0, CLASSES[touch], 0.9);
    });
    runs(rows[TRUTH], (from, to, touch) => touch >= 0 && chart.block([time[from], time[to]], [1.0, 1.05], CLASSES[touch], touch ? 1 : 0.35));
  }

  /** What is said below: of the time that is pointed at. */
  #words() {
    if (this.#pointed === null) return this.#frozen ? "Paused: the run goes on." : this.hint;
    const ago = (1 - this.#pointed) * this.#span;
    const time = this.#rows[TIME] ?? [];
    const at = time.findIndex((each) => each >= this.#end - ago);
    if (at < 0 || time[at] - (this.#end - ago) > GAP) return `${formatNumber(ago, 2, "s")} ago: no data`;
    const [touch, truth, amplitude] = [TOUCH, TRUTH, AMPLITUDE].map((column) => this.#rows[column][at]);
    return [
      `${formatNumber(ago, 2, "s")} ago: ${TOUCHES[touch] ?? "not decided"}`,
      touch > 0 && `roughness ${formatNumber(this.#rows[ROUGHNESS][at], 2)}${this.#rows[UNKNOWN][at] ? ", unknown" : ""}`,
      amplitude > 0 ? `${formatNumber(this.#rows[FREQUENCY][at], 0, "Hz")} at ${percent(amplitude)} of full drive` : "no vibration",
      `sound ${dbfs(this.#rows[LEVEL][at])}`,
      truth >= 0 && `label: ${TOUCHES[truth]}`,
    ].filter(Boolean).join(" · ");
  }
}
