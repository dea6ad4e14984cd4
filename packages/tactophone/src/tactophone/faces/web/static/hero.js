// The fingertip: lights and shakes as it vibrates; the word, roughness as a dial, and the vibration in numbers.

import { formatNumber, percent, put } from "./text.js";
import { TOUCHES } from "./timeline.js";

const RIDGES = [16, 28, 40, 52].map((r) => `<path d="M${100 - 0.8 * r} ${98 + r * 0.5} C${100 - r} ${98 - r} ${100 + r} ${98 - r} ${100 + 0.8 * r} ${98 + r * 0.5}"/>`).join("");
const DRAWING = `<svg class="fingertip" viewBox="0 0 200 210" aria-hidden="true">
  <g class="waves"><path d="M34 70 Q22 100 34 130"/><path d="M18 58 Q2 100 18 142"/><path d="M166 70 Q178 100 166 130"/><path d="M182 58 Q198 100 182 142"/></g>
  <g class="shakes"><path class="skin" d="M48 210 V96 C48 42 70 14 100 14 C130 14 152 42 152 96 V210 Z"/><ellipse class="glow" cx="100" cy="94" rx="42" ry="60"/>
  <g class="ridges">${RIDGES}</g><path class="fold" d="M54 176 Q100 190 146 176"/></g></svg>`;
const DIAL = `<svg class="dial" viewBox="0 0 140 92" aria-hidden="true"><path class="smooth" d="M12 72 A58 58 0 0 1 70 14"/><path class="rough" d="M70 14 A58 58 0 0 1 128 72"/>
  <path class="needle" d="M70 72 L70 24"/><circle cx="70" cy="72" r="6"/><text x="12" y="90">0 smooth</text><text x="128" y="90" text-anchor="end">1 rough</text></svg>`;
const SHAKE = 5; // px at full drive
const calm = matchMedia("(prefers-reduced-motion: reduce)");

export class Hero {
  #node;

  constructor(node) {
    this.#node = node;
    node.innerHTML = `${DRAWING}<div class="readings"><p class="decision" id="decision" data-touch="0">–</p>${DIAL}<dl class="pair">
      <div><dt>Roughness</dt><dd id="roughness-now">–</dd></div><div><dt>Frequency</dt><dd id="frequency">–</dd></div><div><dt>Amplitude</dt><dd id="amplitude">–</dd></div></dl></div>`;
  }

  /** Show the newest values; a `still` picture does not move, and one without data (`lost`) shows no value as if it were new. */
  show({ touch, roughness, amplitude, frequency }, still, lost = false) {
    if (lost) touch = roughness = amplitude = frequency = NaN;
    const known = TOUCHES[touch] !== undefined;
    const parts = Object.fromEntries(["decision", "roughness-now", "frequency", "amplitude"].map((id) => [id, this.#node.querySelector(`#${id}`)]));
    put(parts.decision, known ? TOUCHES[touch] : "–");
    parts.decision.dataset.touch = this.#node.dataset.touch = known ? touch : 0;
    put(parts["roughness-now"], touch > 0 ? formatNumber(roughness, 2) : "–");
    put(parts.frequency, amplitude > 0 ? formatNumber(frequency, 0, "Hz") : "–");
    put(parts.amplitude, percent(Number.isFinite(amplitude) ? amplitude : null));
    this.#node.querySelector(".needle").style.transform = `rotate(${touch > 0 ? 180 * roughness - 90 : -90}deg)`;
    const strength = still || !(amplitude > 0) ? 0 : amplitude;
    this.#node.style.setProperty("--strength", Math.sqrt(strength));
    const shake = calm.matches ? 0 : SHAKE * Math.sqrt(strength) * Math.sin(performance.now() / (frequency > 80 ? 9 : 14));
    this.#node.querySelector(".shakes").style.transform = `translateX(${shake}px)`;
  }
}
