// A level meter: bar, threshold, slowly falling peak, and a lamp that stays lit after clipping.

import { dbfs, put } from "./text.js";

export const FULL_SCALE = 0.999; // as signal/perception/health.py
const LOWEST = -100; // dBFS
const LAMP = 3000; // ms
const FALL = 0.25; // dB a frame

export class Meter {
  #peak = LOWEST;
  #clippedAt = -LAMP;

  constructor(node, name) {
    node.innerHTML = "<b></b><span class=track><i class=level></i><i class=peak></i><i class=mark hidden></i></span><em>clip</em><output></output>";
    this.parts = Object.fromEntries(["b", ".level", ".peak", ".mark", "em", "output"].map((key) => [key, node.querySelector(key)]));
    this.parts.b.textContent = name;
    node.role = "group";
    node.ariaLabel = `${name} microphone`;
  }

  show(level, low, high, threshold) {
    this.#peak = Math.max(level, this.#peak - FALL);
    if (high >= FULL_SCALE || low <= -FULL_SCALE) this.#clippedAt = performance.now();
    this.parts[".level"].style.transform = `scaleX(${share(level)})`;
    this.parts[".peak"].style.left = `${100 * share(this.#peak)}%`;
    this.parts[".mark"].hidden = !Number.isFinite(threshold);
    this.parts[".mark"].style.left = `${100 * share(threshold)}%`;
    this.parts.em.dataset.lit = performance.now() - this.#clippedAt < LAMP;
    put(this.parts.output, dbfs(level));
  }

  /** Show that nothing is heard. */
  clear() {
    this.#peak = LOWEST;
    this.#clippedAt = -LAMP;
    this.show(LOWEST, 0, 0, NaN);
    put(this.parts.output, dbfs(NaN));
  }
}

const share = (level) => Math.min(1, Math.max(0, 1 - (level || LOWEST) / LOWEST));
