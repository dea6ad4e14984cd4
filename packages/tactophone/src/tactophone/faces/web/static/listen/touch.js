// What is felt of windows: signal/perception/evidence.py, touch_state.py and no_touch.py in JavaScript. Their numbers come
// from there (app/listen.py writes the module). Contact is simpler here: by the level of each window, over one threshold.

import {
  CAUTION, END_MEMORY, END_UNDER, FADED_DB, FADED_PAUSE, FADING, GREATEST_STEP, LEAST, LIFT, MOST, NOTICE_FROM,
  NOTICE_MEMORY, PAUSE, RELEASE_DB, ROUGH_FROM, SCORE_LIMIT, TOUCH_HOLD,
} from "../../telephone.js";

const CLOSED = 0, OPEN = 1, HELD = 2; // states of contact
const CERTAINLY_NONE = [1, 0, 0];
const HIGHEST_SMOOTH = 0.5 - 2 ** -54;

const within = (low, value, high) => Math.min(Math.max(value, low), high);

function logit(share) {
  const inside = within(1e-6, share, 1 - 1e-6);
  return Math.log(inside / (1 - inside));
}

/** The roughness of a rough share: 0.5 at the threshold, linear on both sides. */
function roughnessOf(share, threshold) {
  return share < threshold ? (0.5 * share) / threshold : 0.5 + (0.5 * (share - threshold)) / (1 - threshold);
}

/** Evidence that a touch is rough: the sum of what its windows say, bounded on both sides. A new touch begins as smooth. */
export class Evidence {
  #even;
  #abstainFrom;
  #heardAt = -Infinity;

  constructor({ rough_on: on, rough_off: off, abstain_from: abstainFrom }) {
    this.#even = (logit(on) + logit(off)) / 2;
    this.#abstainFrom = abstainFrom;
    this.#begin();
  }

  #begin() {
    this.sum = LEAST;
    this.rough = this.known = false;
    this.share = 0;
  }

  /** Take a window of touch; `now` in s, ascending. */
  hear([none, smooth, rough], now) {
    if (now - this.#heardAt > LIFT) this.#begin();
    this.#heardAt = now;
    this.known = none < this.#abstainFrom;
    if (!this.known) return; // unlike all training: it says nothing
    this.share = smooth + rough > 0 ? rough / (smooth + rough) : 0.5;
    const total = this.sum + within(-GREATEST_STEP, logit(this.share) - this.#even - CAUTION, GREATEST_STEP);
    this.known = total <= LEAST || total >= MOST;
    this.sum = within(LEAST, total, MOST);
    if (this.sum >= ROUGH_FROM) this.rough = true;
    else if (this.sum <= LEAST) this.rough = false; // between the two the verdict stands
  }

  /** How rough the newest window is, 0 to 1; on the verdict's side of 0.5. */
  get roughness() {
    const roughness = roughnessOf(this.share, 1 / (1 + Math.exp(-this.#even)));
    return this.rough ? Math.max(roughness, 0.5) : Math.min(roughness, HIGHEST_SMOOTH);
  }
}

/** Whether the sound of late is speech, rain or typing, by a regression on the model's features that its card brings. */
class NoTouch {
  #mean = END_UNDER;
  noticed = false;

  constructor({ weights, bias }) {
    this.weights = weights;
    this.bias = bias;
  }

  /** Take a window; return whether it, or the sound of late, is no touch. */
  hears(features, [, smooth, rough], loud) {
    if (!loud || (rough <= smooth && !this.noticed)) return this.noticed;
    const evidence = this.weights.reduce((sum, weight, place) => sum + weight * features[place], this.bias);
    const score = within(-SCORE_LIMIT, evidence, SCORE_LIMIT);
    // A notice comes soon and goes late.
    this.#mean += (score - this.#mean) / (this.noticed ? END_MEMORY : NOTICE_MEMORY);
    this.noticed = this.#mean >= (this.noticed ? END_UNDER : NOTICE_FROM);
    return this.noticed || score > 0;
  }
}

/** Windows in; the touch that is felt out. */
export class Touch {
  #contact = CLOSED;
  #heldSince = 0; // s
  #loudUntil = -Infinity; // s
  #pause = PAUSE; // s that the verdict is felt over a silence

  constructor(card) {
    this.evidence = new Evidence(card.decision);
    this.noTouch = card.settings.no_touch ? new NoTouch(card.settings.no_touch) : null;
  }

  /**
   * Take a window that ends at `end` s, with its level and what the model says of it. Returns the touch, its roughness,
   * whether that is unknown, whether the sound is one of touch at all, and the probabilities that counted.
   */
  push({ probabilities, features, level, end }, threshold) {
    this.#follow(level, threshold, end);
    const loud = level >= threshold;
    const said = this.noTouch?.hears(features, probabilities, loud) ? CERTAINLY_NONE : probabilities;
    if (loud) this.evidence.hear(said, end);
    const unknown = this.#contact !== CLOSED && !this.evidence.known;
    return { ...this.#felt(end), unknown, isTouch: !this.noTouch?.noticed, probabilities: said };
  }

  /** Open contact by the level, and hold it over a silence as short as that of a stroke that turns. */
  #follow(level, threshold, now) {
    if (level >= threshold + FADED_DB) this.#loudUntil = now;
    const lingers = this.#contact === OPEN && level >= threshold - RELEASE_DB;
    if (level >= threshold || lingers) {
      this.#contact = OPEN;
    } else if (this.#contact === OPEN) {
      this.#contact = HELD;
      this.#heldSince = now;
      this.#pause = now - this.#loudUntil >= FADING ? FADED_PAUSE : PAUSE; // what faded out is likely to turn
    } else if (now - this.#heldSince > TOUCH_HOLD) {
      this.#contact = CLOSED;
    }
  }

  #felt(now) {
    if (this.#contact === CLOSED) return { touch: "none", roughness: 0 };
    const silent = this.#contact === HELD && now - this.#heldSince >= this.#pause;
    if (silent || this.noTouch?.noticed) return { touch: "smooth", roughness: 0 };
    return { touch: this.evidence.rough ? "rough" : "smooth", roughness: this.evidence.roughness };
  }
}
