// *Feel it here*: the button, the way it is rendered, and the feed of commands while it is on.

import { Ages, STALE } from "./age.js";
import { foldOnPhone, put } from "./text.js";
import { Feed } from "./feed.js";
import { Fingertip } from "./fingertip.js";
import { Toggle } from "./press.js";

const $ = (id) => document.getElementById(id);
const FINGER = Number(new URLSearchParams(location.search).get("finger") ?? 0);
const LATE = `Silent: what comes is older than ${STALE / 1000} s. The connection is slow, or this page stood still.`;
const ages = new Ages();
let feed = null;
let lost = "";

const fingertip = new Fingertip({
  onWay: (text, way) => {
    put($("feel-way"), lost || text);
    $("feel-way").dataset.way = way;
  },
});

function show(on) {
  feeling.on = on;
  $("feel").ariaPressed = on;
  put($("feel"), on ? "Stop feeling" : $("feel").dataset.label ?? "Feel it here");
}

function end() {
  show(false);
  fingertip.stop();
  feed?.close();
  feed = null;
  lost = "";
  put($("feel-way"), "");
}

async function begin() {
  show(true);
  feed = new Feed(FINGER ? `feel?finger=${FINGER}` : "feel", {
    onMessage: ({ header, tables }) => {
      ages.ask(feed);
      const age = ages.of(header.made);
      fingertip.take({ ...header, age }, tables.vibration.numbers);
      const late = age >= STALE && age < Infinity ? LATE : "";
      const muted = header.armed ? late : `Muted here too: ${header.muted_because || "the run is muted"}.`;
      if (muted !== lost) {
        lost = muted;
        put($("feel-way"), lost || fingertip.words);
      }
    },
    onAnswer: (answer) => ages.take(answer),
    onLost: (why) => { put($("feel-way"), `Silent: ${why}.`); },
  });
  await fingertip.start();
  fingertip.volume = $("feel-volume").valueAsNumber;
  fingertip.overtones = true;
  fingertip.choose($("feel-by").value);
}

// On a phone the button stands alone above the fold.
if ($("feel-more")) foldOnPhone($("feel-more"));

const feeling = new Toggle($("feel"), { begin, end });
addEventListener("pagehide", end); // a browser may show the page again as it was left
$("feel-by").addEventListener("change", ({ target }) => fingertip.choose(target.value));
$("feel-volume").addEventListener("input", ({ target }) => { fingertip.volume = target.valueAsNumber; });
