// Before a call: whether the microphones hear the finger and the actuator is felt, while nobody is connected yet.

import { FULL_SCALE } from "./meter.js";
import { dbfs, lines } from "./text.js";

const UNCONNECTED = /^(calling|listening|waiting)/; // how RunState.link begins until somebody is connected
const PATIENCE = 3000; // ms: a run whose two sides start together is connected by then
const DEAD = -95; // dBFS: no microphone is so quiet
const JUMP = 12; // dB over the quietest: the finger is heard
const SETTLE = 1000; // ms until a microphone has settled

class Ear {
  #begun = performance.now();
  #quietest = Infinity;
  #heard = false;
  #clipped = false;

  constructor(name) {
    this.name = name;
  }

  take(level, low, high) {
    if (performance.now() - this.#begun < SETTLE || !Number.isFinite(level)) return;
    this.#quietest = Math.min(this.#quietest, Math.max(DEAD, level));
    this.#heard ||= level > this.#quietest + JUMP;
    this.#clipped ||= high >= FULL_SCALE || low <= -FULL_SCALE;
  }

  line(level) {
    const begin = `${this.name} microphone, ${dbfs(level)}: `;
    if (this.#clipped) return [`${begin}too loud, it clips: turn its gain down.`, "bad"];
    if (this.#heard) return [`${begin}it hears the finger.`, "good"];
    if (level < DEAD) return [`${begin}silent. Is it connected, and its gain up?`, "bad"];
    return [`${begin}stroke the finger, and the level should jump.`, "unknown"];
  }
}

export class Check {
  #panel = document.querySelector("#check-panel");
  #list = document.querySelector("#check");
  #ears = [new Ear("Contact"), new Ear("Air")];
  #alone = performance.now(); // since when nobody is connected
  #buzzed = false;

  /** `levels`: of each microphone level in dBFS, lowest and highest sample; `local`: whether this page may buzz. */
  show(state, levels, local) {
    const unconnected = Boolean(state) && UNCONNECTED.test(state.link);
    if (!unconnected) this.#alone = performance.now();
    this.#panel.hidden = !unconnected || performance.now() - this.#alone < PATIENCE;
    if (!unconnected) return;
    this.#buzzed ||= state.buzzing;
    lines(this.#list, state.role === "robot" ? this.#robot(state, levels) : this.#operator(state, local));
  }

  #robot({ channels }, levels) {
    return this.#ears.slice(0, channels).map((ear, k) => {
      ear.take(...levels[k]);
      return ear.line(levels[k][0]);
    });
  }

  #operator({ output, can_buzz: possible }, local) {
    if (!output || output === "none") return [[`No actuator: press Feel it here${local ? ", then Buzz now" : ""}.`, "unknown"]];
    const begin = `Actuator ${output}: `;
    if (!possible) return [[`${begin}it plays the sound itself, so it is felt once sound comes.`, "unknown"]];
    if (this.#buzzed) return [[`${begin}it buzzed. Nothing felt? Look at the amplifier and its cable.`, "good"]];
    return [[`${begin}${local ? "press Buzz now" : "press Buzz now on a page on that machine"}, and it should be felt.`, "unknown"]];
  }
}
