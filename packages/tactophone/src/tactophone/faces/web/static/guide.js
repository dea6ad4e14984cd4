// The page of a guided command: its steps, the button of each step, meters, and the result; it decides nothing itself.

import { capital, percent, put, putCommand } from "./text.js";
import { socketTo } from "./feed.js";
import { Meter } from "./meter.js";

const $ = (id) => document.getElementById(id);
const meters = new Map();
// Each tip over glass, and the mark that it leaves there when it is inked.
const GLASS = '<path class="glass" d="M8 74H112"/>';
const TIPS = {
  rubber: ["Soft rubber, silicone", "mark: a round blot, 2 mm", '<path d="M34 10H86V44C86 66 74 74 60 74C46 74 34 66 34 44Z"/><ellipse class="ink" cx="60" cy="92" rx="22" ry="9"/>'],
  pad: ["Hard skin on a silicone pad", "mark: 0.1 to 0.5 mm", '<path d="M30 10H90V40C90 62 76 70 60 70C44 70 30 62 30 40Z"/><path class="skin" d="M32 52C40 72 50 74 60 74C70 74 80 72 88 52"/><ellipse class="ink" cx="60" cy="92" rx="8" ry="4"/>'],
  plastic: ["Rod or pen of plastic", "mark: 0.1 mm", '<path d="M50 10H70V60Q70 74 60 74Q50 74 50 60Z"/><ellipse class="ink" cx="60" cy="92" rx="4" ry="2.5"/>'],
  stylus: ["Steel rod", "mark: a dot", '<path d="M52 10H68V44L60 74L52 44Z"/><circle class="ink" cx="60" cy="92" r="1.8"/>'],
};

function element(name, text, properties = {}) {
  return Object.assign(document.createElement(name), { textContent: text, ...properties });
}

function showSteps({ steps, step }) {
  if (steps) $("steps").replaceChildren(...steps.map((name) => element("li", name)));
  for (const [place, item] of [...$("steps").children].entries()) {
    item.dataset.done = place < step;
    if (place === step) item.setAttribute("aria-current", "step");
    else item.removeAttribute("aria-current");
  }
}

function showButtons(buttons) {
  const items = Object.entries(buttons).map(([name, label]) => element("button", label, { type: "button", className: "primary", value: name }));
  for (const item of items) {
    const [title, mark, drawing] = TIPS[item.value] ?? [];
    if (drawing) {
      item.className = "tip";
      item.innerHTML = `<svg viewBox="0 0 120 104" aria-hidden="true">${drawing}${GLASS}</svg><b>${item.value}</b><span>${title}</span><span>${mark}</span>`;
    }
    item.addEventListener("click", () => {
      socket.send(item.value);
      for (const each of items) each.disabled = true; // answered, until the command says what comes next
    });
  }
  $("buttons").replaceChildren(...items);
}

function showLevels(levels) {
  if (!levels.length) {
    $("meters").replaceChildren();
    meters.clear();
  }
  for (const [name, level, peak] of levels) {
    if (!meters.has(name)) {
      const box = element("div", "", { className: "meter", id: `${name}-meter` });
      $("meters").append(box);
      meters.set(name, new Meter(box, name === "contact" ? "Contact" : "Air"));
    }
    const amplitude = 10 ** (peak / 20);
    meters.get(name).show(level, -amplitude, amplitude);
  }
}

/** What is left of a step, as a ring that runs out around the seconds. */
function showCountdown([left, whole]) {
  $("ring").hidden = left === undefined;
  $("state").hidden = !$("ring").hidden;
  if (left === undefined) return;
  $("ring").style.setProperty("--left", Math.min(1, left / whole));
  put($("seconds"), String(Math.ceil(left)));
}

/** A finding of the terminal as a sentence of the page. */
const shown = (line) => capital(line).replaceAll("`", "");

function showResult({ objects, before, after, words, command, findings = [] }) {
  const share = (value) => (value === null ? "–" : percent(value));
  const rows = [...objects, { name: "balanced", rough: null, before, after }].map(({ name, rough, before, after }) => {
    const row = document.createElement("tr");
    row.append(element("th", name, { scope: "row" }), element("td", rough === null ? "" : rough ? "rough" : "smooth"), element("td", share(before)), element("td", share(after)));
    return row;
  });
  $("objects").replaceChildren(...rows);
  put($("summary"), words);
  putCommand($("next"), command);
  $("findings").replaceChildren(...findings.map((line) => element("li", shown(line))));
  put($("instruction"), "Finished: the result is below, with what to run next.");
  $("result-panel").hidden = false;
}

function show(update) {
  if (update.title) {
    put($("title"), update.title);
    put($("run"), update.about);
    document.title = `Tactophone: ${update.title.toLowerCase()}`;
  }
  if (update.steps || "step" in update) showSteps(update);
  if ("instruction" in update) put($("instruction"), capital(update.instruction));
  if (update.buttons) showButtons(update.buttons);
  if ("state" in update) put($("state"), update.state);
  if (update.countdown) showCountdown(update.countdown);
  if (update.levels) showLevels(update.levels);
  if (update.findings) $("faults").replaceChildren(...update.findings.map((line) => element("p", shown(line))));
  if (update.result) showResult(update.result);
}

function life(text, alive) {
  put($("life"), text);
  $("life").dataset.alive = alive;
}

// The page's server ends with the command, so a lost connection is not sought again.
const socket = socketTo("guide");
socket.addEventListener("open", () => life("connected", true));
socket.addEventListener("message", ({ data }) => show(JSON.parse(data)));
socket.addEventListener("close", ({ reason }) => {
  const done = !$("result-panel").hidden;
  life(done ? "done" : reason || "ended", done ? "done" : false);
  $("buttons").replaceChildren();
});
