// How old a command of the run is when this page takes it, however long the page stood still or the network held it.
//
// Each second the page asks the run for its time. The answer was written after the question, so an age reckoned from the question is
// never too small; it is too great by at most the way to the run and back.

export const STALE = 300; // ms: an older command is not rendered
const INTERVAL = 1000; // ms between two questions
const KEPT = 10; // answers; the quickest of them counts
const clocks = () => [performance.now(), Date.now()]; // the first is never set, the second goes on while the device sleeps

export class Ages {
  #asked = [-Infinity, -Infinity];
  #least = []; // of each answer: the page's clocks less the run's, in ms, at least

  /** Ask, if it is time; call it with each message. */
  ask(feed) {
    const now = clocks();
    if (now[0] - this.#asked[0] < INTERVAL) return;
    this.#asked = now;
    feed.send({ action: "time", time: now[0] });
  }

  /** An answer: what was asked (`time`), and the run's clock in s (`now`). */
  take({ time, now }) {
    if (time !== this.#asked[0]) return;
    this.#least = [...this.#least.slice(1 - KEPT), this.#asked.map((clock) => clock - 1000 * now)];
  }

  /** The greatest age in ms that what was made at `made`, in s of the run's clock, can have. */
  of(made) {
    return Math.max(...clocks().map((clock, k) => clock - 1000 * made - Math.max(...this.#least.map((least) => least[k]))));
  }
}
