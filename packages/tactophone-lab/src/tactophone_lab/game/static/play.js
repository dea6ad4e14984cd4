// The stone box: start, round, reveal. Predictions and the order of the stones arrive only when the curtain is lifted.

import { put, formatNumber } from "../static/text.js";
import { Feed } from "../static/feed.js";
import { reveal, saveCard } from "./reveal.js";
import { Ages, STALE } from "../static/age.js";
import { Fingertip } from "../static/fingertip.js";
import { Speaker } from "../static/speaker.js";
import { StateBar } from "../static/statebar.js";
import { Hand } from "./stage.js";

const $ = (id) => document.getElementById(id);
const LONGEST_DELAY = 1000; // ms after a touch; later sound has another cause
const TEST = { pieces: 12, size: 2400 }; // samples: 50 ms each
const ages = new Ages();
const delays = [];
let begun = 0;
let touchedAt = -Infinity;
let testing = 0;
let ceiling = 0;
let asked = false;

const speaker = new Speaker((time) => {
  const delay = time - touchedAt;
  touchedAt = -Infinity;
  if (delay <= 0 || delay > LONGEST_DELAY) return;
  delays.push(delay);
  const middle = [...delays].sort((a, b) => a - b)[delays.length >> 1];
  put($("delay"), `From press to sound: ${formatNumber(delay)} ms, median ${formatNumber(middle)} ms`);
  feed.send({ action: "delay", seconds: delay / 1000 });
});

// The motor of a phone or gamepad beside the sound, which always plays.
const motor = new Fingertip({ onWay: () => {}, quiet: true });

const feed = new Feed("player", {
  onMessage: ({ header, tables }) => {
    if (header.result) return lift(header, tables);
    speaker.ceiling = ceiling = header.ceiling;
    ages.ask(feed);
    const age = ages.of(header.made);
    if (!testing) {
      if (age < STALE) speaker.play(tables.vibration.numbers);
      motor.take({ ...header, age });
    }
    $("test").disabled = !header.alive || !header.armed || Boolean(testing);
    bar.take({ ...header, age: 0 }, header.alive && tables.vibration.rows);
    $("begin").disabled = $("again").disabled = !header.alive || bar.state === "stopped";
    if (header.armed) ask("");
    if (header.detected) train(header);
  },
  onAnswer: ({ refused, command, ...answer }) => {
    if (answer.now) ages.take(answer);
    if (refused) put($("message"), refused);
    if (command) bar.command = command;
  },
  onLost: (why) => {
    bar.lost(why);
    $("test").disabled = $("begin").disabled = $("again").disabled = true;
  },
});

const bar = new StateBar((request) => feed.send(request), { ready: "ready" });

const hand = new Hand($("stage"), $("finger"), {
  onMove: ({ x, y, force }) => feed.send({ action: "move", x, y, force }),
  onTouch: () => { touchedAt = performance.now(); },
  pressure: () => Number(document.querySelector("[name=press]:checked").value),
});

const marks = Array.from({ length: 5 }, (_, k) => {
  const mark = Object.assign(document.createElement("button"), { type: "button", textContent: `${k + 1} rough?` });
  mark.ariaPressed = false;
  mark.addEventListener("click", () => toggle(mark));
  return mark;
});
$("marks").append(...marks);

const chosen = () => marks.flatMap((mark, k) => (mark.ariaPressed === "true" ? [k] : []));

function toggle(mark) {
  const wanted = mark.ariaPressed !== "true";
  const third = wanted && chosen().length === 2;
  mark.ariaPressed = wanted && !third;
  showMarked(third);
}

/** Whether the curtain can be lifted, and if not why. */
function showMarked(third = false) {
  const missing = 2 - chosen().length;
  const words = ["", "Mark one stone more to lift the curtain.", "Mark two stones to lift the curtain."][missing];
  put($("marked"), third ? "Two stones are marked already: take one of the marks off first." : words);
  $("done").disabled = missing > 0;
}

function train({ detected, truth }) {
  const name = (touch) => `<b class="${touch}">${touch === "none" ? "nothing" : touch}</b>`;
  const text = `${name(truth)} under the finger, ${name(detected)} detected`;
  if ($("message").innerHTML !== text) $("message").innerHTML = text;
}

function show(screen) {
  document.body.dataset.screen = screen;
}

/** A muted round cannot be felt: say so, and begin it at the second press alone. */
function ask(question) {
  asked = Boolean(question);
  put($("begin"), asked ? "Begin all the same" : "Begin");
  put($("question"), question);
}

async function begin() {
  if (bar.state === "muted" && !asked) return ask("The run is muted: nobody would feel this round. Press Resume above first.");
  ask("");
  show("play");
  begun = performance.now();
  delays.length = 0;
  ["message", "delay"].forEach((id) => put($(id), ""));
  marks.forEach((mark) => { mark.ariaPressed = false; });
  showMarked();
  feed.send({ action: "begin", trainer: $("trainer").checked });
  $("stage").focus();
  put($("message"), await startOutput());
}

/** Start sound and motor, from a button's handler; returns what is missing, in words. The motor goes on without sound. */
async function startOutput() {
  motor.start();
  try {
    await speaker.start();
  } catch (error) {
    return error.message;
  }
  speaker.volume = $("volume").valueAsNumber;
  speaker.overtones = $("overtones").checked;
  return "";
}

/** Before a round: a rough vibration, half the ceiling, made by this page alone; it ends as soon as the run is muted. */
async function test() {
  const missing = await startOutput();
  let left = TEST.pieces;
  clearInterval(testing);
  testing = setInterval(() => {
    if (left-- > 0 && bar.armed) {
      const begin = (TEST.pieces - left) * TEST.size;
      speaker.play(Float32Array.from({ length: TEST.size }, (_, k) => 0.5 * ceiling * Math.sin((2 * Math.PI * 60 * (begin + k)) / 48000)));
      return motor.take({ command: [0.5 * ceiling, 1, 60], ceiling, armed: true, alive: true });
    }
    clearInterval(testing);
    testing = 0;
    motor.take({ command: [0, 0, 60], ceiling, armed: true, alive: true });
    put($("test-state"), missing || "A buzz of half a second? Then begin. Nothing? Turn the volume up, take headphones, or add overtones, and press again.");
  }, TEST.size / 48);
}

function lift(header, tables) {
  show("reveal");
  const { rounds, right } = header.past;
  if (rounds) put($("standing"), `${right} of ${rounds} rounds all right`);
  reveal(header, tables);
}

$("test").addEventListener("click", test);
$("begin").addEventListener("click", begin);
$("card").addEventListener("click", saveCard);
$("again").addEventListener("click", () => show("door"));
$("volume").addEventListener("input", ({ target }) => { speaker.volume = target.valueAsNumber; });
$("overtones").addEventListener("change", ({ target }) => { speaker.overtones = target.checked; });
$("done").addEventListener("click", () => {
  hand.lift();
  feed.send({ action: "choose", stones: chosen() });
});
addEventListener("keydown", (event) => {
  if (document.body.dataset.screen === "play" && event.key >= "1" && event.key <= "5") toggle(marks[event.key - 1]);
});
setInterval(() => put($("clock"), `${formatNumber((performance.now() - begun) / 1000)} s`), 1000);
