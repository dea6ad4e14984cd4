// Runs in the audio thread: plays the received vibration at the loudspeaker's own clock.

const TARGET = 0.03 * sampleRate; // samples buffered: four messages of 8 ms
const MOST = 0.15 * sampleRate; // a longer buffer is stale and is skipped
const HURRY = 0.02; // greatest change of speed, a ninth of the just-noticeable difference of a vibration's frequency
const SILENCE = 0.1 * sampleRate; // samples of silence after which a vibration counts as a new one
const CAPACITY = 1 << 15;

class Vibration extends AudioWorkletProcessor {
  #ring = new Float32Array(CAPACITY);
  #written = 0;
  #read = 0;
  #waiting = true;
  #silent = SILENCE;

  constructor() {
    super();
    this.port.onmessage = ({ data }) => this.#take(data);
  }

  process(inputs, [[out]]) {
    const buffered = this.#written - this.#read;
    if (this.#waiting && buffered < TARGET) return true;
    this.#waiting = buffered < out.length + 2;
    if (this.#waiting) return true;
    const speed = 1 + HURRY * Math.max(-1, Math.min(1, (buffered - TARGET) / TARGET));
    for (let k = 0; k < out.length; k++) {
      const whole = Math.floor(this.#read);
      const part = this.#read - whole;
      out[k] = (1 - part) * this.#at(whole) + part * this.#at(whole + 1);
      this.#read = Math.min(this.#read + speed, this.#written - 1);
    }
    this.#detectOnset(out);
    return true;
  }

  #at(index) {
    return this.#ring[index % CAPACITY];
  }

  #take(samples) {
    if (samples === null) {
      this.#read = this.#written;
      this.#waiting = true;
      return;
    }
    for (const sample of samples.subarray(-CAPACITY / 2)) this.#ring[this.#written++ % CAPACITY] = sample;
    if (this.#written - this.#read > MOST) this.#read = this.#written - TARGET;
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
