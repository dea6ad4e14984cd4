// Runs in the audio thread: plays the received vibration at the loudspeaker's own clock.

const LEAST = 0.01 * sampleRate; // samples buffered at first: two messages of 4 ms, and what the audio thread takes at once
const GREATEST = 0.04 * sampleRate; // on a connection that stalls
const GROWTH = 0.005 * sampleRate; // after each underrun while something vibrates
const CALM = 0.0001; // share of the growth that is taken back per sample played
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
    this.#target = Math.max(LEAST, this.#target - CALM * out.length);
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
    for (const sample of samples.subarray(-CAPACITY / 2)) this.#ring[this.#written++ % CAPACITY] = sample;
    if (this.#written - this.#read > MOST) this.#read = this.#written - this.#target;
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
