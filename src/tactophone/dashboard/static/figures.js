// Numbers and words of the page: link, latency, faults. Every function takes what the run told and fills a node.

const STAGE_WORDS = {
  capture: "capture", encode: "encode", network: "network", playout: "playout",
  decode: "decode", judge: "judge", render: "render", device: "device",
};
const MINUS = "−";
const formats = [0, 1, 2].map((digits) => new Intl.NumberFormat("en", { minimumFractionDigits: digits, maximumFractionDigits: digits }));

/** A number with so many digits (0 to 2), or a dash where there is none. */
export function tell(value, digits = 0, unit = "") {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = formats[digits].format(Math.abs(value));
  return `${value < 0 && /[1-9]/.test(text) ? MINUS : ""}${text}${unit && `\u202f${unit}`}`;
}

export const percent = (share, digits = 0) => tell(share === null ? null : 100 * share, digits, "%");
export const milliseconds = (seconds, digits = 1) => tell(seconds === null ? null : 1000 * seconds, digits, "ms");
export const dbfs = (value) => tell(value, 0, "dBFS");

/** Set the rows of a definition list, touching only what has changed. */
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

/** Set a text, if it is another one: a screen reader need not hear it twice. */
export function put(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** Statistics of the link. */
export function showLink(node, counters, gauges) {
  const total = counters.packets_received + counters.packets_lost;
  const warn = (count) => (count ? "warn" : "");
  list(node, [
    ["received", tell(counters.packets_received), "packets that arrived and were genuine"],
    ["lost", `${tell(counters.packets_lost)} · ${percent(gauges.loss_ratio ?? ratio(counters.packets_lost, total), 1)}`,
      "packets that never came, or too late; share in the last seconds", warn(counters.packets_lost)],
    ["recovered", tell(counters.packets_recovered), "lost packets whose sound came with the next ones"],
    ["concealed", tell(counters.packets_concealed), "lost packets whose sound was guessed", warn(counters.packets_concealed)],
    ["late", tell(counters.packets_late), "packets dropped because they came after their turn", warn(counters.packets_late)],
    ["duplicated", tell(counters.packets_duplicated), "packets that came more than once"],
    ["rejected", tell(counters.packets_rejected), "datagrams that were not genuine", warn(counters.packets_rejected)],
    ["skipped", tell(counters.packets_skipped), "packets too old to be judged after a stall"],
    ["jitter", milliseconds(gauges.jitter, 2), "RFC 3550"],
    ["playout delay", milliseconds(gauges.playout_delay), "how long sound waits for late packets"],
    ["clock skew", tell(gauges.clock_skew_ppm, 0, "ppm"), "how much faster the other side's sound clock runs"],
    ["bitrate", tell(gauges.bitrate_bps === null ? null : gauges.bitrate_bps / 1000, 0, "kbit/s"), "all headers included"],
    ["round trip", milliseconds(gauges.round_trip), "to the other side and back"],
    ["redundancy", tell(gauges.redundancy), "earlier packets carried in each packet"],
  ]);
}

/** The latency budget: a bar of stages, its key, and the end-to-end figure measured apart. */
export function showLatency({ stack, stages, total }, gauges) {
  const budget = Object.keys(STAGE_WORDS).map((stage) => [stage, gauges[`latency_${stage}`]]);
  const known = budget.filter(([, seconds]) => seconds !== null);
  const sum = known.reduce((so_far, [, seconds]) => so_far + seconds, 0);
  put(total, gauges.latency_total === null ? "not measured yet" : `${milliseconds(gauges.latency_total)} from end to end`);
  if (stack.children.length !== budget.length) {
    stack.replaceChildren(...budget.map(([stage]) => Object.assign(document.createElement("i"), { className: stage })));
  }
  budget.forEach(([, seconds], k) => { stack.children[k].style.flexGrow = sum ? (seconds ?? 0) / sum : 0; });
  stack.ariaLabel = known.length
    ? `Latency budget: ${known.map(([stage, seconds]) => `${stage} ${milliseconds(seconds)}`).join(", ")}`
    : "Latency budget: not measured yet";
  list(stages, [
    ...budget.map(([stage, seconds]) => [STAGE_WORDS[stage], milliseconds(seconds, 2), "median", stage]),
    ["sum of stages", known.length ? milliseconds(sum, 2) : "–", "to be compared with the figure from end to end", "sum"],
  ]);
}

/** What is wrong, in words with what to do; nothing at all when all is well. */
export function showFaults(node, faults) {
  const texts = faults.map((fault) => fault.text);
  if (node.dataset.texts === texts.join("\n")) return;
  node.dataset.texts = texts.join("\n");
  node.replaceChildren(...texts.map((text) => Object.assign(document.createElement("p"), { textContent: text })));
}

function ratio(part, whole) {
  return whole ? part / whole : null;
}
