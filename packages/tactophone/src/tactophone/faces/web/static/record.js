// The button Record: a log of the run from now on, written at the machine; the page shows what the machine reports.

import { put } from "./text.js";

export class Record {
  #button = null;
  #line = document.querySelector("#recording");

  constructor(send) {
    this.send = send;
  }

  /** `path`: the file, empty while there is none. A run that cannot be recorded reports nothing, and has no button. */
  show(path) {
    this.#button ??= this.#make();
    this.#button.ariaPressed = Boolean(path);
    put(this.#button, path ? "Stop recording" : "Record");
    put(this.#line, path ? `Recording to ${path}` : "");
  }

  #make() {
    const button = Object.assign(document.createElement("button"), { type: "button", className: "quiet", id: "record" });
    button.addEventListener("click", () => this.send({ action: "record", value: button.ariaPressed !== "true" }));
    this.#line.before(button);
    return button;
  }
}
