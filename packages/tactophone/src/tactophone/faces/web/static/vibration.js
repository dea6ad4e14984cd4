// Runs in the audio thread: plays the received vibration at the loudspeaker's own clock.

const LEAST = 0.01 * sampleRate; // samples buffered on average at first: two messages of 4 ms, and what the audio thread takes at once
const GREATEST = 0.04 * sampleRate; // on a connection that stalls
const GROWTH = 0.005 * sampleRate; // after each underrun while something vibrates
const LOOK = 2 * sampleRate; // samples between two looks at how much of the buffer was never used
const SPARE = 0.003 * sampleRate; // samples that must have been left in the fullest need; half of the rest is given back
const MOST = 0.15 * sampleRate; // a longer buffer is stale and is skipped
const HURRY = 0.02; // greatest change of speed, a ninth of the just-noticeable difference of a vibration's frequency
const SILENCE = 0.1 * sampleRate; // samples of silence after which a vibration counts as a new one
const CAPACITY = 1 << 15;

class Vibration extends AudioWorkletProcessor {
  #ring = new Float32Array(CAPACITY);
  #written = 0;
  #read = 0;
  #waiting = true;
  #target = LEAST;
  #lowest = Infinity; // samples buffered, since the last look
  #played = 0; // samples, since the last look
  #soundEnd = 0; // index after the last sample written that is not 0
  #silent = SILENCE;

  constructor() {
    super();
    this.port.onmessage = ({ data }) => this.#take(data);
  }

  process(inputs, [[out]]) {
    const buffered = this.#written - this.#read;
    if (this.#waiting && buffered < this.#target) return true;
    this.#waiting = buffered < out.length + 2;
    if (this.#waiting) {
      if (this.#silent < SILENCE) this.#target = Math.min(GREATEST, this.#target + GROWTH);
      return true;
    }
    this.#look(buffered, out.length);
    const speed = 1 + HURRY * Math.max(-1, Math.min(1, (buffered - this.#target) / this.#target));
    for (let k = 0; k < out.length; k++) {
      const whole = Math.floor(this.#read);
      const part = this.#read - whole;
      out[k] = (1 - part) * this.#at(whole) + part * this.#at(whole + 1);
      this.#read = Math.min(this.#read + speed, this.#written - 1);
    }
    this.#detectOnset(out);
    return true;
  }

  /** Every `LOOK`, give back half of what was left of the buffer even when messages came latest. */
  #look(buffered, count) {
    this.#lowest = Math.min(this.#lowest, buffered);
    this.#played += count;
    if (this.#played < LOOK) return;
    this.#target = Math.max(LEAST, this.#target - Math.max(0, this.#lowest - SPARE) / 2);
    this.#lowest = Infinity;
    this.#played = 0;
  }

  #at(index) {
    return this.#ring[index % CAPACITY];
  }

  #take(samples) {
    if (samples === null) {
      this.#read = this.#written;
      this.#waiting = true;
      this.#silent = SILENCE;
      return;
    }
    this.#dropSilence(samples.length);
    for (const sample of samples.subarray(-CAPACITY / 2)) {
      this.#ring[this.#written++ % CAPACITY] = sample;
      if (sample !== 0) this.#soundEnd = this.#written;
    }
    if (this.#written - this.#read > MOST) this.#read = this.#written - this.#target;
  }

  /**
   * Before a message of `count` samples: of what is buffered, if it is silence alone, keep no more than bridges the wait
   * for the message after it. So a vibration begins at once, however much had piled up before.
   */
  #dropSilence(count) {
    const kept = Math.max(0, this.#target - count / 2);
    if (this.#soundEnd <= this.#read && this.#written - this.#read > kept) this.#read = this.#written - kept;
  }

  /** Post the time at which sound starts after silence. */
  #detectOnset(out) {
    for (let k = 0; k < out.length; k++) {
      if (out[k] === 0) {
        this.#silent++;
        continue;
      }
      if (this.#silent >= SILENCE) this.port.postMessage({ time: currentTime + k / sampleRate });
      this.#silent = 0;
    }
  }
}

registerProcessor("vibration", Vibration);
