// The curtain: where the finger is, in metres of the box, by pointer or keys.

export const PITCH = 0.11; // m, as stones.py has it
export const WIDTH = 0.085;
export const DEPTH = 0.07;
const MARGIN = 0.015;
const LENGTH = 4 * PITCH + WIDTH;
const STEP = 0.004; // m a key press

/** Put five slots into a stage; upright on a phone. `mark(slot, k)` may dress each. */
export function lay(stage, mark = (slot, k) => { slot.textContent = k + 1; }) {
  stage.querySelectorAll(".slot").forEach((slot) => slot.remove());
  for (let k = 0; k < 5; k++) {
    const slot = Object.assign(document.createElement("div"), { className: "slot" });
    const [from, to] = [place(stage, k * PITCH, 0), place(stage, k * PITCH + WIDTH, DEPTH)];
    slot.style.left = `${100 * from[0]}%`;
    slot.style.top = `${100 * from[1]}%`;
    slot.style.width = `${100 * (to[0] - from[0])}%`;
    slot.style.height = `${100 * (to[1] - from[1])}%`;
    mark(slot, k);
    stage.append(slot);
  }
}

const upright = (stage) => stage.clientHeight > stage.clientWidth;

/** Share of the stage's width and height at which a place in the box lies. */
export function place(stage, x, y) {
  const along = (x + MARGIN) / (LENGTH + 2 * MARGIN);
  const across = (y + MARGIN) / (DEPTH + 2 * MARGIN);
  return upright(stage) ? [across, along] : [along, across];
}

function within(stage, left, top) {
  const [along, across] = upright(stage) ? [top, left] : [left, top];
  return [along * (LENGTH + 2 * MARGIN) - MARGIN, across * (DEPTH + 2 * MARGIN) - MARGIN];
}

/** Follows pointer and keys; tells every change by `onMove({x, y, force})`, and each touch-down by `onTouch()`. */
export class Hand {
  #stage;
  #finger;
  #x = LENGTH / 2;
  #y = DEPTH / 2;
  #force = -1;

  constructor(stage, finger, { onMove, onTouch, pressure }) {
    this.#stage = stage;
    this.#finger = finger;
    Object.assign(this, { onMove, onTouch, pressure });
    for (const kind of ["pointerdown", "pointermove", "pointerup", "pointercancel"]) {
      stage.addEventListener(kind, (event) => this.#point(event));
    }
    stage.addEventListener("keydown", (event) => this.#key(event));
    stage.addEventListener("blur", () => this.#go(this.#x, this.#y, -1));
    new ResizeObserver(() => { lay(stage); this.#draw(); }).observe(stage);
  }

  lift() {
    this.#go(this.#x, this.#y, -1);
  }

  #point(event) {
    event.preventDefault();
    if (event.type === "pointerdown") {
      this.#stage.focus();
      this.#stage.setPointerCapture(event.pointerId);
    }
    const pressed = event.type === "pointerdown" || (event.type === "pointermove" && event.buttons > 0);
    // A pen knows how hard it is pressed; of mice and most screens all that is known is that they are.
    const share = event.pointerType === "pen" ? 2 * event.pressure : 1;
    const box = this.#stage.getBoundingClientRect();
    const [x, y] = within(this.#stage, (event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
    this.#go(x, y, pressed ? this.pressure() * share : -1);
  }

  #key(event) {
    const turn = upright(this.#stage);
    const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    if (event.key === " ") this.#go(this.#x, this.#y, this.#force > 0 ? -1 : this.pressure());
    else if (event.key in steps) {
      const [right, down] = steps[event.key];
      const [along, across] = turn ? [down, right] : [right, down];
      this.#go(this.#x + STEP * along, this.#y + STEP * across, this.#force);
    } else return;
    event.preventDefault();
  }

  #go(x, y, force) {
    const touched = force > 0 && this.#force <= 0;
    this.#x = Math.min(Math.max(x, -MARGIN), LENGTH + MARGIN);
    this.#y = Math.min(Math.max(y, -MARGIN), DEPTH + MARGIN);
    this.#force = force;
    this.#draw();
    this.onMove({ x: this.#x, y: this.#y, force });
    if (touched) this.onTouch();
  }

  #draw() {
    const [left, top] = place(this.#stage, this.#x, this.#y);
    this.#finger.style.left = `${100 * left}%`;
    this.#finger.style.top = `${100 * top}%`;
    this.#finger.dataset.pressed = this.#force > 0;
  }
}
