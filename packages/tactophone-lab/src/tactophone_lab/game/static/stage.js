// The curtain: the finger's place in the box, in metres, by pointer or keys.

export const PITCH = 0.11; // m, as in game.py
export const WIDTH = 0.085;
export const DEPTH = 0.07;
const MARGIN = 0.015;
const LENGTH = 4 * PITCH + WIDTH;
const STEP = 0.004; // m a key press
const SPEED = 0.12; // m/s of the arm while it presses; at higher speed, the shipped detector classifies smooth as rough

/** Put five slots into a stage; vertical on a phone. `mark(slot, k)` fills each. */
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

/** A place in the box as shares of the stage's width and height. */
export function place(stage, x, y) {
  const along = (x + MARGIN) / (LENGTH + 2 * MARGIN);
  const across = (y + MARGIN) / (DEPTH + 2 * MARGIN);
  return upright(stage) ? [across, along] : [along, across];
}

function within(stage, left, top) {
  const [along, across] = upright(stage) ? [top, left] : [left, top];
  return [along * (LENGTH + 2 * MARGIN) - MARGIN, across * (DEPTH + 2 * MARGIN) - MARGIN];
}

/**
 * The fingertip: follows pointer and keys, while it presses at the speed of a robot's arm.
 * Calls `onMove({x, y, force})` on every change, and `onTouch()` on every touch-down.
 */
export class Hand {
  #stage;
  #finger;
  #here = { x: LENGTH / 2, y: DEPTH / 2, force: -1 };
  #goal = { x: LENGTH / 2, y: DEPTH / 2 };
  #stepped = null; // ms, time of the last step towards the goal

  constructor(stage, finger, { onMove, onTouch, pressure }) {
    this.#stage = stage;
    this.#finger = finger;
    Object.assign(this, { onMove, onTouch, pressure });
    for (const kind of ["pointerdown", "pointermove", "pointerup", "pointercancel"]) {
      stage.addEventListener(kind, (event) => this.#point(event));
    }
    stage.addEventListener("keydown", (event) => this.#key(event));
    stage.addEventListener("blur", () => this.lift());
    new ResizeObserver(() => { lay(stage); this.#draw(); }).observe(stage);
  }

  lift() {
    this.#lead(this.#goal.x, this.#goal.y, -1);
  }

  #point(event) {
    event.preventDefault();
    if (event.type === "pointerdown") {
      this.#stage.focus();
      this.#stage.setPointerCapture(event.pointerId);
    }
    const pressed = event.type === "pointerdown" || (event.type === "pointermove" && event.buttons > 0);
    // A pen reports its pressure; mice and most screens report only that they are pressed.
    const share = event.pointerType === "pen" ? 2 * event.pressure : 1;
    const box = this.#stage.getBoundingClientRect();
    const [x, y] = within(this.#stage, (event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
    this.#lead(x, y, pressed ? this.pressure() * share : -1);
  }

  #key(event) {
    const turn = upright(this.#stage);
    const { x, y } = this.#goal;
    const { force } = this.#here;
    const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    if (event.key === " ") this.#lead(x, y, force > 0 ? -1 : this.pressure());
    else if (event.key in steps) {
      const [right, down] = steps[event.key];
      const [along, across] = turn ? [down, right] : [right, down];
      this.#lead(x + STEP * along, y + STEP * across, force);
    } else return;
    event.preventDefault();
  }

  #lead(x, y, force) {
    this.#goal = { x: Math.min(Math.max(x, -MARGIN), LENGTH + MARGIN), y: Math.min(Math.max(y, -MARGIN), DEPTH + MARGIN) };
    const slides = force > 0 && this.#here.force > 0;
    const touched = force > 0 && this.#here.force <= 0;
    if (!slides || force !== this.#here.force) this.#go(slides ? this.#here : this.#goal, force);
    if (touched) this.onTouch();
    if (slides && this.#stepped === null) {
      this.#stepped = performance.now();
      requestAnimationFrame((now) => this.#step(now));
    }
  }

  /** Move towards the goal, until it is reached or the finger lifts. */
  #step(now) {
    const [x, y] = [this.#goal.x - this.#here.x, this.#goal.y - this.#here.y];
    const share = Math.min(1, (SPEED * Math.max(0, now - this.#stepped)) / 1000 / Math.hypot(x, y));
    const done = this.#here.force <= 0 || !(Math.hypot(x, y) > 0);
    this.#stepped = done ? null : now;
    if (done) return;
    this.#go({ x: this.#here.x + share * x, y: this.#here.y + share * y }, this.#here.force);
    requestAnimationFrame((next) => this.#step(next));
  }

  #go({ x, y }, force) {
    this.#here = { x, y, force };
    this.#draw();
    this.onMove(this.#here);
  }

  #draw() {
    const [left, top] = place(this.#stage, this.#here.x, this.#here.y);
    this.#finger.style.left = `${100 * left}%`;
    this.#finger.style.top = `${100 * top}%`;
    this.#finger.dataset.pressed = this.#here.force > 0;
  }
}
