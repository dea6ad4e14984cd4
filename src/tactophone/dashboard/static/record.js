// The button Record: a log of the run from now on, written at the machine; the page shows what the machine reports.

import { put } from "./figures.js";

export class Record {
  #button = document.querySelector("#record");
  #line = document.querySelector("#recording");

  constructor(send) {
    this.#button.addEventListener("click", () => send({ action: "record", value: this.#button.ariaPressed !== "true" }));
  }

  /** `path`: the file, empty while there is none. A run that cannot be recorded reports nothing, and has no button. */
  show(path) {
    this.#button.hidden = false;
    this.#button.ariaPressed = Boolean(path);
    put(this.#button, path ? "Stop recording" : "Record");
    put(this.#line, path ? `Recording to ${path}` : "");
  }
}
