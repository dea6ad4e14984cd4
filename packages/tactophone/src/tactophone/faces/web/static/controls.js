// The controls. The page shows the settings that the run reports, never those requested.

import { dbfs, percent, put } from "./text.js";

const HOLD = 1000; // ms for which a slider stays where it was set, until the run has answered

export class Controls {
  #form = document.querySelector("#controls");
  #answer = document.querySelector("#answer");
  #held = new Map();
  #buzzers = document.querySelectorAll(".buzz-now");

  constructor(send) {
    this.send = send;
    this.local = false; // whether this page may strengthen the vibration
    for (const button of this.#buzzers) button.addEventListener("click", () => this.#request({ action: "buzz" }));
    this.#slider("level", "input", (value) => ({ action: "output_level", value }));
    this.#slider("threshold", "input", (value) => ({ action: "threshold_dbfs", value }));
    // A lowered ceiling stays lowered, so only the value at which the slider is released is sent.
    this.#slider("ceiling", "change", (value) => ({ action: "ceiling", value }));
    this.#form.profile.addEventListener("change", ({ target }) => this.#request({ action: "profile", text: target.value }));
    this.#form.addEventListener("submit", (event) => event.preventDefault());
  }

  /** Show the settings of the run, or that there is no run. */
  show(state, alive) {
    const idle = !alive || state.role === "replay";
    for (const part of document.querySelectorAll(".controls")) part.inert = idle;
    this.#form.ceiling.max = state.ceiling;
    this.#set("level", state.output_level, percent);
    this.#set("ceiling", state.ceiling, percent);
    this.#set("threshold", state.threshold_dbfs, dbfs);
    this.#showBuzz(state, idle);
    this.#showProfiles(state);
    this.#showFloor(state.noise_floor_dbfs);
  }

  /** Show why a request was refused. */
  refuse(reason) {
    put(this.#answer, `Refused: ${reason}.`);
    this.#held.clear();
  }

  #request(request) {
    put(this.#answer, "");
    this.send(request);
  }

  #slider(name, event, toRequest) {
    const slider = this.#form[name];
    slider.addEventListener("input", () => this.#held.set(name, performance.now()));
    slider.addEventListener(event, () => this.#request(toRequest(slider.valueAsNumber)));
  }

  #set(name, value, format) {
    const held = performance.now() - (this.#held.get(name) ?? -HOLD) < HOLD;
    if (value !== null && !held) this.#form[name].value = value;
    const shown = held ? this.#form[name].valueAsNumber : value;
    put(document.querySelector(`output[for=${name}]`), format(shown));
    this.#form[name].ariaValueText = format(shown);
  }

  #showProfiles({ profile, profiles }) {
    const select = this.#form.profile;
    if (select.options.length !== profiles.length) select.replaceChildren(...profiles.map((name) => new Option(name)));
    if (document.activeElement !== select) select.value = profile;
  }

  /** A press vibrates for a moment, as strongly as anything may now. */
  #showBuzz({ can_buzz: possible, armed, ceiling, output_level: level, output }, idle) {
    document.querySelector("#buzz-part").hidden = document.querySelector("#check-buzz").hidden = !possible || !this.local;
    for (const button of this.#buzzers) button.disabled = idle || !armed || !(ceiling * level > 0);
    const here = output === "none" ? " This run drives no actuator: press Feel it here first." : "";
    const strength = `0.3 s at ${percent(ceiling * level)} of full drive, the ceiling at this output level.${here}`;
    put(document.querySelector("#buzz-hint"), armed ? strength : "Not while it is muted or stopped.");
  }

  #showFloor(floor) {
    const mark = document.querySelector("#floor-mark");
    const { min, max } = this.#form.threshold;
    mark.hidden = floor === null;
    mark.style.left = `${(100 * (Math.max(floor ?? 0, min) - min)) / (max - min)}%`;
    put(document.querySelector("#floor"), floor === null ? "Noise floor: not measured yet." : `Noise floor ${dbfs(floor)}, marked on the slider.`);
  }
}
