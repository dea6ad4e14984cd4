// The button Record in the state bar, with a clock: a log of the run from now on, written at the machine.
// The page shows what the machine reports: starting, on, ending, saved or failed.

import { clock, fileSize, put, putWords } from "./text.js";

const BUSY = ["starting", "on"]; // phases that a press ends
const WITHIN = "The run began long ago, so this can be felt (`tactophone feel`) and not replayed; `--record` keeps a run from its start.";

export class Record {
  #button = null;
  #line = document.querySelector("#recording");
  #hint = document.querySelector("#record-hint");
  #told = { phase: "off" };
  #begun = 0; // ms of this page's clock
  #asked = null; // what the newest press wants, until the machine answers

  constructor(send) {
    this.send = send;
    setInterval(() => this.#draw(), 250);
  }

  /** `told`: the machine's answer; `now`: s of its clock, where the answer is an older one. */
  show(told, now = told.since) {
    this.#told = told;
    this.#asked = null;
    if (told.phase === "on") this.#begun = performance.now() - 1000 * (now - told.since);
    this.#button ??= this.#make();
    this.#draw();
  }

  /** Whether a log begun now would hold the run from its start, as a replay needs. */
  set whole(whole) {
    if (this.#button) putWords(this.#hint, whole || this.#told.phase !== "off" ? "" : `Record keeps the run from now on. ${WITHIN}`);
  }

  #make() {
    const button = Object.assign(document.createElement("button"), { type: "button", id: "record" });
    button.setAttribute("aria-describedby", "record-hint");
    button.addEventListener("click", () => {
      this.#asked = !BUSY.includes(this.#told.phase) && this.#asked !== true;
      this.send({ action: "record", value: this.#asked });
      this.#draw();
    });
    document.querySelector("#mute").before(button);
    return button;
  }

  #draw() {
    if (!this.#button) return;
    const { phase } = this.#told;
    const elapsed = (performance.now() - this.#begun) / 1000;
    const starting = phase === "starting" || this.#asked === true;
    const ending = phase === "ending" || (this.#asked === false && phase !== "off");
    const word = ending ? "Ending" : starting ? "Starting" : phase === "on" ? `Rec ${clock(elapsed)}` : "Record";
    put(this.#button, word);
    this.#button.ariaPressed = !ending && (starting || phase === "on");
    this.#button.ariaLabel = this.#button.ariaPressed === "true" ? "Rec: end the recording" : "Record";
    this.#button.disabled = ending;
    putWords(this.#line, this.#sentence(starting, ending));
  }

  #sentence(starting, ending) {
    const { phase, file, folder, whole, seconds, bytes, trouble } = this.#told;
    if (ending) return "Ending the recording.";
    if (starting) return "Starting to record.";
    if (phase === "on") return `Recording to \`${file}\` in \`${folder}\`. ${whole ? "" : WITHIN}`;
    if (phase === "failed") return `Not recorded: ${trouble}.`;
    if (phase !== "saved") return "";
    const next = whole ? `tactophone replay ${file}` : `tactophone feel ${file}`;
    return `Saved: \`${file}\`, ${clock(seconds)}, ${fileSize(bytes)}, in \`${folder}\`. ${trouble ? `Beware: ${trouble}. ` : ""}Next: \`${next}\``;
  }
}
