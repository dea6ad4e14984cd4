// Runs in the audio thread: collects the microphone's sound in messages of uint32 position, then float32 samples.

const SIZE = 256; // samples, 5.3 ms: two of the audio thread's blocks

class Capture extends AudioWorkletProcessor {
  #buffer = new ArrayBuffer(4 + 4 * SIZE);
  #filled = 0;
  #position = 0;

  process([[channel]]) {
    if (!channel) return true;
    new Float32Array(this.#buffer, 4).set(channel, this.#filled);
    this.#filled += channel.length;
    if (this.#filled === SIZE) {
      new DataView(this.#buffer).setUint32(0, this.#position, true);
      this.#position = (this.#position + SIZE) >>> 0;
      this.port.postMessage(this.#buffer, [this.#buffer]);
      this.#buffer = new ArrayBuffer(4 + 4 * SIZE);
      this.#filled = 0;
    }
    return true;
  }
}

registerProcessor("capture", Capture);
