// The stone box: door, round, reveal. Nothing of what is heard or believed comes here before the curtain is lifted.

import { put, tell } from "./figures.js";
import { Feed } from "./live.js";
import { reveal } from "./reveal.js";
import { Speaker } from "./speaker.js";
import { Hand } from "./stage.js";

const $ = (id) => document.getElementById(id);
const HEARD_WITHIN = 1000; // ms after a touch; what is heard later was not of it
const delays = [];
let begun = 0;
let touchedAt = -Infinity;

const speaker = new Speaker((time) => {
  const delay = time - touchedAt;
  touchedAt = -Infinity;
  if (delay <= 0 || delay > HEARD_WITHIN) return;
  delays.push(delay);
  const middle = [...delays].sort((a, b) => a - b)[delays.length >> 1];
  put($("delay"), `From press to sound: ${tell(delay)} ms, median ${tell(middle)} ms`);
  feed.send({ action: "heard", delay: delay / 1000 });
});

const feed = new Feed("box", {
  onMessage: ({ words, tables }) => {
    if (words.result) return lift(words, tables);
    speaker.play(tables.vibration.numbers);
    if (words.alive) showLife(words.armed ? "ready" : "muted by a fault: begin a new round", words.armed);
    else showLife("starting", false);
    $("begin").disabled = $("again").disabled = !words.alive;
    if (words.felt) train(words);
  },
  onAnswer: ({ refused }) => { if (refused) put($("told"), refused); },
  onLost: (why) => {
    showLife(why, false);
    $("begin").disabled = $("again").disabled = true;
  },
});

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
  const on = mark.ariaPressed !== "true" && chosen().length < 2;
  mark.ariaPressed = on;
  $("done").disabled = chosen().length !== 2;
}

function train({ felt, truth }) {
  const name = (touch) => `<b class="${touch}">${touch === "none" ? "nothing" : touch}</b>`;
  const text = `${name(truth)} under the finger, ${name(felt)} felt`;
  if ($("told").innerHTML !== text) $("told").innerHTML = text;
}

function showLife(text, ready) {
  put($("life"), text);
  $("life").dataset.alive = ready;
}

function show(screen) {
  document.body.dataset.screen = screen;
}

async function begin() {
  show("play");
  begun = performance.now();
  delays.length = 0;
  ["told", "delay"].forEach((id) => put($(id), ""));
  marks.forEach((mark) => { mark.ariaPressed = false; });
  $("done").disabled = true;
  feed.send({ action: "begin", trainer: $("trainer").checked });
  $("stage").focus();
  await speaker.start();
  speaker.volume = $("volume").valueAsNumber;
  speaker.overtones = $("overtones").checked;
}

function lift(words, tables) {
  show("reveal");
  const { rounds, right } = words.past;
  if (rounds) put($("standing"), `${right} of ${rounds} rounds all right`);
  reveal(words, tables);
}

$("begin").addEventListener("click", begin);
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
setInterval(() => put($("clock"), `${tell((performance.now() - begun) / 1000)} s`), 1000);
