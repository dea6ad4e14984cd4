// Numbers and texts of the page: link, jitter, latency, faults. Every function takes values of the run and fills a node.

const STAGES = {
  capture: "capture", encode: "encode", network: "network", playout: "playout",
  decode: "decode", detect: "detect", render: "render", device: "device",
};
export const FULL_SCALE = 0.999; // as perception/health.py
const MINUS = "−";
const GOAL = 0.025; // s: the latency that a hand does not notice
const formats = [0, 1, 2].map((digits) => new Intl.NumberFormat("en", { minimumFractionDigits: digits, maximumFractionDigits: digits }));

/** Format a number with 0 to 2 digits after the point, or a dash where there is none. */
export function formatNumber(value, digits = 0, unit = "") {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = formats[digits].format(Math.abs(value));
  return `${value < 0 && /[1-9]/.test(text) ? MINUS : ""}${text}${unit && `\u202f${unit}`}`;
}

export const percent = (share, digits = 0) => formatNumber(share === null ? null : 100 * share, digits, "%");
export const milliseconds = (seconds, digits = 1) => formatNumber(seconds === null ? null : 1000 * seconds, digits, "ms");
export const dbfs = (value) => formatNumber(value, 0, "dBFS");

/** Set the rows of a definition list; unchanged rows are left alone. */
export function list(node, rows) {
  if (node.children.length !== rows.length) {
    node.replaceChildren(...rows.map(() => {
      const row = document.createElement("div");
      row.append(document.createElement("dt"), document.createElement("dd"));
      return row;
    }));
  }
  rows.forEach(([name, value, hint, mark], k) => {
    const row = node.children[k];
    put(row.firstChild, name);
    put(row.lastChild, value);
    if (row.title !== (hint ?? "")) row.title = hint ?? "";
    row.dataset.mark = mark ?? "";
  });
}

/** Set a text only if it changed, so that a screen reader does not repeat it. */
export function put(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** Statistics of the link. */
export function showLink(node, counters, gauges) {
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
export function showHealth(node, { link, output }, counters, gauges) {
  const total = counters.packets_received + counters.packets_lost;
  const loss = gauges.loss_ratio ?? ratio(counters.packets_lost, total);
  const word = loss > 0.05 ? "bad" : loss > 0.01 ? "fair" : "good";
  const jitter = gauges.jitter === null ? "" : `, ${milliseconds(gauges.jitter)} jitter`;
  const late = gauges.latency_total > GOAL;
  const sentences = [
    [total ? `Link ${word}: ${percent(loss, 1)} lost lately, ${formatNumber(counters.packets_lost)} of ${formatNumber(total)} in all${jitter}.` : `Link: ${link || "none, this run is local"}.`, word],
    [gauges.latency_total === null ? "Latency: not measured yet." : `Latency ${late ? "fair" : "good"}: ${milliseconds(gauges.latency_total)} from touch to vibration, goal ${milliseconds(GOAL, 0)}.`, late ? "fair" : "good"],
    [`Actuator: ${!output || output === "none" ? "none; press Feel it here to feel this run on this device" : output}.`, "good"],
    [counters.xruns ? `Sound device: ${formatNumber(counters.xruns)} ${counters.xruns === 1 ? "period" : "periods"} lost.` : "Sound device: no period lost.", counters.xruns ? "fair" : "good"],
  ];
  if (node.children.length !== sentences.length) node.replaceChildren(...sentences.map(() => document.createElement("li")));
  sentences.forEach(([text, mark], k) => {
    put(node.children[k], text);
    node.children[k].dataset.mark = mark;
  });
}

/** The latency budget: a bar of stages, its key, and the end-to-end latency, which is measured independently. */
export function showLatency({ stack, stages, total }, gauges) {
  const budget = Object.keys(STAGES).map((stage) => [stage, gauges[`latency_${stage}`]]);
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
    ...budget.map(([stage, seconds]) => [STAGES[stage], milliseconds(seconds, 2), "median", stage]),
    ["sum of stages", known.length ? milliseconds(sum, 2) : "–", "compare with the end-to-end latency", "sum"],
  ]);
}

/** Faults as texts with the next step; empty without faults. */
export function showFaults(node, faults) {
  const texts = faults.map((fault) => fault.text);
  if (node.dataset.texts === texts.join("\n")) return;
  node.dataset.texts = texts.join("\n");
  node.replaceChildren(...texts.map((text) => Object.assign(document.createElement("p"), { textContent: text })));
}

function ratio(part, whole) {
  return whole ? part / whole : null;
}
