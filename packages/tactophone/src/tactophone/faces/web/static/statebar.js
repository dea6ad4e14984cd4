// The state bar of every page that can vibrate: starting, live, muted, stopped, no data, replay or ended; why; and the buttons Mute and Stop.

import { capital, formatNumber, put, putCommand, putWords } from "./text.js";
import { Toggle } from "./press.js";
import { listenForStop } from "./stop.js";

const STALE = 400; // ms without anything new, after which what is shown is greyed
const SILENT = 500; // ms, after which the bar says so
const GONE = 3600; // s: the age of a run that ended in order
const STOPPED = /^emergency stop/;
const ENDED = "the run has ended"; // as the page's server says before it goes
const COVER = "<div id=over><h2>The run has ended</h2><p>Nothing on this page moves or vibrates any more. Start it again on its machine:</p>"
  + "<p><code id=command></code></p><p>or see what runs there: <code>tactophone status</code></p></div>"
  + "<div id=adrift><h2>This page has lost the run</h2><p>The run may go on, and vibrate. Press the space bar at its terminal, or stop it on its machine by:</p>"
  + "<p><code>tactophone stop</code></p></div>";

function sentence(text) {
  return text && `${capital(text)}${/[.!?]$/.test(text) ? "" : "."}`;
}

function element(name, properties) {
  return Object.assign(document.createElement(name), { type: "button", ...properties });
}

export class StateBar {
  #node = document.querySelector("#state");
  #life = element("b", { id: "life", textContent: "connecting" });
  #cause = element("span", { id: "cause" });
  #mute = element("button", { id: "mute", textContent: "Mute", disabled: true });
  #stop = element("button", { id: "stop", textContent: "Stop", disabled: true });
  #cover = element("div", { role: "alert", id: "cover", className: "cover", hidden: true, innerHTML: COVER });
  #vibration;
  #dataAt = -Infinity;
  #run = {}; // alive, age, armed, muted_because, role, starting of the newest message
  #waiting = "";
  #lost = "";
  #refused = "";

  /** `send(request)`; `ready`: the word for a run that vibrates; `waiting`: what brings the first sound. */
  constructor(send, { ready = "live", waiting = "Waiting for sound from the robot's side." } = {}) {
    this.send = send;
    this.ready = ready;
    this.waiting = waiting;
    const words = element("p", { role: "status" });
    words.append(this.#life, this.#cause);
    this.#node.append(words, this.#mute, this.#stop);
    this.#mute.setAttribute("aria-keyshortcuts", "m");
    document.querySelector("main").before(this.#cover);
    this.command = "tactophone";
    this.#vibration = new Toggle(this.#mute, { begin: () => this.#ask("arm", this.#run.silenced), end: () => this.#ask("mute") });
    const look = () => ({ stopped: this.state === "stopped", armed: this.#run.armed, silenced: this.#run.silenced });
    listenForStop(this.#stop, (...asked) => this.#ask(...asked), look);
    setInterval(() => this.#show(), 100);
  }

  /** Whether the run may vibrate here, as far as the page knows. */
  get armed() { return this.state === "live"; }

  /** Seconds since the newest data; the charts move on by it. */
  get silence() { return (performance.now() - this.#dataAt) / 1000; }

  /** The newest header of the run; `fresh`: it brought data. */
  take(header, fresh) {
    this.#lost = "";
    this.#waiting = header.waiting_for ?? "";
    const before = this.#run.silenced;
    this.#run = { ...this.#run, ...header };
    if (this.#run.silenced !== before) this.#vibration.on = true; // so that Resume is offered a second from now
    if (fresh) this.#dataAt = performance.now();
    this.#show();
  }

  lost(why) {
    if (this.#lost === ENDED && why === "disconnected") return; // it seeks the server that has ended
    this.#lost = why;
    this.#show();
  }

  refuse(reason) {
    this.#refused = sentence(`refused: ${reason}`);
    setTimeout(() => { this.#refused = ""; }, 5000);
    this.#show();
  }

  /** The command line of the run, for when it has ended. */
  set command(text) {
    putCommand(this.#cover.querySelector("#command"), text);
  }

  /** `silenced`: how often the run had been stopped or muted when the button was pressed; what came since is not released. */
  #ask(action, silenced) {
    this.#refused = "";
    this.send({ action, silenced });
  }

  /** The state, its words, and why. */
  #look() {
    const { alive, age, armed, muted_because: why, role, starting, paused } = this.#run;
    if (this.#lost === ENDED) return ["ended", "ended", "The run has ended."];
    if (this.#lost) return ["ended", this.#lost, "This page gets nothing from the run."];
    if (this.#waiting) return ["waiting", "waiting", `Waiting for the run “${this.#waiting}”: it appears here as soon as it starts.`];
    if (alive === undefined) return ["waiting", "connecting", ""];
    if (starting) return ["waiting", "starting", starting];
    if (!alive && age >= GONE) return ["ended", "ended", "The run has ended."];
    // Before silence: a stopped run is released by holding alone, whether sound arrives or not.
    const halted = STOPPED.test(why ?? "") && `${sentence(why.replace(/, then resume$/, ""))} Then hold the button to resume.`;
    if (halted && alive && role !== "robot") return ["stopped", "stopped", halted];
    if (this.#dataAt === -Infinity) return ["waiting", alive ? "waiting" : "starting", `${this.waiting}${this.#mutedToo}`];
    if (this.silence * 1000 > SILENT && role !== "replay") {
      const cause = alive ? "No sound arrives: the robot's side is stopped, or the link is broken." : "The run gives no sign of life.";
      return ["silent", `no data ${formatNumber(this.silence, 1)} s`, cause];
    }
    if (role === "replay" && armed) return ["waiting", "replay", paused ? "Paused." : "A recording plays. No actuator is driven: press Feel it here to feel it on this device."];
    if (role === "robot") return ["live", this.ready, "This is the robot's side: nothing vibrates here."];
    return armed ? ["live", this.ready, "Vibration is on."] : ["muted", "muted", sentence((why ?? "").replace(/^muted(: |$)/, ""))];
  }

  /** What a run that waits for sound would not let through either. */
  get #mutedToo() {
    const { alive, armed, role } = this.#run;
    return alive && armed === false && !["replay", "robot"].includes(role) ? " It is muted: press Resume." : "";
  }

  #show() {
    const [state, word, cause] = this.#look();
    this.state = state;
    this.#node.dataset.state = state;
    document.body.dataset.stale = this.silence * 1000 > STALE || state === "ended";
    put(this.#life, word);
    putWords(this.#cause, this.#refused || cause);
    const passive = this.#run.role === "robot";
    this.#mute.hidden = passive || state === "stopped";
    this.#stop.hidden = passive;
    // A run that waits for sound may vibrate already: by Buzz now.
    const ready = Boolean(this.#run.alive) && !this.#run.starting && !this.#waiting && !this.#lost;
    this.#mute.disabled = !ready;
    this.#stop.disabled = state === "ended" || (state === "waiting" && !ready);
    const armed = this.#run.armed !== false;
    this.#vibration.on = armed;
    put(this.#mute, armed ? "Mute" : this.#vibration.begins ? "Resume" : "Muted");
    put(this.#stop, state === "stopped" ? "Hold to resume" : "Stop");
    const over = state === "ended" && this.#lost !== "opened in another window" && !/reload|pages are open/.test(this.#lost);
    this.#cover.hidden = !over;
    this.#cover.querySelector("#over").hidden = word !== "ended";
    this.#cover.querySelector("#adrift").hidden = word === "ended";
    for (const part of document.querySelectorAll("main, #hand")) part.inert = over;
  }
}
