// The page of a guided command: its steps, the button of each step, meters, and the result; it decides nothing itself.

import { percent, put } from "./figures.js";
import { socketTo } from "./live.js";
import { Meter } from "./meter.js";

const $ = (id) => document.getElementById(id);
const meters = new Map();

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
  for (const item of items) item.addEventListener("click", () => socket.send(item.value));
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

function showResult({ objects, before, after, words }) {
  const share = (value) => (value === null ? "–" : percent(value));
  const rows = [...objects, { name: "balanced", rough: null, before, after }].map(({ name, rough, before, after }) => {
    const row = document.createElement("tr");
    row.append(element("th", name, { scope: "row" }), element("td", rough === null ? "" : rough ? "rough" : "smooth"), element("td", share(before)), element("td", share(after)));
    return row;
  });
  $("objects").replaceChildren(...rows);
  put($("summary"), words);
  $("result-panel").hidden = false;
}

function show(update) {
  if (update.steps || "step" in update) showSteps(update);
  if ("instruction" in update) put($("instruction"), update.instruction);
  if ("picture" in update) {
    put($("picture"), update.picture);
    $("picture").hidden = !update.picture;
  }
  if (update.buttons) showButtons(update.buttons);
  if ("state" in update) put($("state"), update.state);
  if (update.levels) showLevels(update.levels);
  if (update.findings) $("faults").replaceChildren(...update.findings.map((line) => element("p", line)));
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
  life(reason || "ended", false);
  $("buttons").replaceChildren();
});
