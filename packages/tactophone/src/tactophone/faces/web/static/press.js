// Buttons that begin something and end it again. To end takes one press. A press begins only what this page has shown as off for a
// second: not the second press of a double click, not one that was meant for what stood there before, and no key that is held.

const SLIP = 1000; // ms

// A browser presses a button anew at each repeat of Enter; here a key that is held presses any button once.
document.addEventListener("keydown", (event) => { if (event.repeat && event.target.closest("button")) event.preventDefault(); });

export class Toggle {
  #offSince = -Infinity; // ms, of the page's clock
  #end;

  /** `begin()` and `end()`; a press that begins nothing ends. */
  constructor(button, { begin, end }) {
    this.#end = end;
    button.addEventListener("click", ({ timeStamp }) => (this.#begins(timeStamp) ? begin() : this.#stop()));
  }

  /** Whether it is on, as often as that is known anew. */
  set on(on) { this.#offSince = on ? Infinity : Math.min(this.#offSince, performance.now()); }

  /** Whether a press begins it now. */
  get begins() { return this.#begins(performance.now()); }

  #begins(at) { return at - this.#offSince >= SLIP; }

  #stop() {
    if (this.#offSince < Infinity) this.#offSince = performance.now(); // whoever goes on pressing ends
    this.#end();
  }
}
