// Plays the vibration as sound; reports when sound starts after silence.

const RATE = 48000;

export const NEEDS_HTTPS = "Sound is missing: a browser plays it only at a secure address. Start again with --https, or open the page on the machine itself.";

export class Speaker {
  #context = null;
  #node = null;
  #gain = null;
  #reach = null;
  #ceiling = null;
  #shaper = null;
  #loading = null;

  /** `onSound(time)`: the first vibration after silence left the loudspeaker at that time of `performance.now()`. */
  constructor(onSound) {
    this.onSound = onSound;
  }

  /** Browsers allow sound only after a button press: call this from its handler. Throws what is missing, in words. */
  async start() {
    if (this.#node) return this.#context.resume();
    this.#loading ??= this.#load().finally(() => { this.#loading = null; }); // one, however often the button is pressed
    return this.#loading;
  }

  async #load() {
    this.#context ??= new AudioContext({ sampleRate: RATE, latencyHint: 0 });
    // Plain http over a network is no secure context, and there is no audioWorklet.
    if (!this.#context.audioWorklet) throw new Error(NEEDS_HTTPS);
    await this.#context.audioWorklet.addModule(new URL("./vibration.js", import.meta.url));
    this.#node = new AudioWorkletNode(this.#context, "vibration", { numberOfInputs: 0, outputChannelCount: [1] });
    this.#node.port.addEventListener("message", ({ data }) => this.#report(data));
    this.#node.port.start();
    this.#shaper = new WaveShaperNode(this.#context);
    const noConstant = new BiquadFilterNode(this.#context, { type: "highpass", frequency: 25 });
    this.#gain = new GainNode(this.#context);
    // Overtones and the filter may overshoot: what is over the ceiling is cut, by a curve that ends at -1 and 1.
    this.#reach = new GainNode(this.#context, { gain: 0 });
    const limiter = new WaveShaperNode(this.#context, { curve: [-1, 0, 1] });
    this.#ceiling = new GainNode(this.#context, { gain: 0 });
    this.#node.connect(this.#shaper).connect(noConstant).connect(this.#gain).connect(this.#reach).connect(limiter).connect(this.#ceiling).connect(this.#context.destination);
  }

  /** The ceiling of the run, 0 to 1 of full scale, at each message; silent until it is known. */
  set ceiling(value) {
    if (!this.#ceiling || this.#ceiling.gain.value === Math.fround(value)) return;
    this.#reach.gain.value = value > 0 ? 1 / value : 0;
    this.#ceiling.gain.value = value > 0 ? value : 0;
  }

  /** Queue samples. */
  play(samples) {
    if (samples.length) this.#node?.port.postMessage(samples);
  }

  /** Drop what is queued. */
  silence() {
    this.#node?.port.postMessage(null);
  }

  /** 0 to 1: of what the run renders, and never more. */
  set volume(value) {
    this.#gain?.gain.setTargetAtTime(Math.min(1, value), this.#context.currentTime, 0.02);
  }

  /** Small loudspeakers cannot play 60 Hz: full-wave rectification adds its octaves, at any amplitude. */
  set overtones(enabled) {
    const curve = Float32Array.from({ length: 1025 }, (_, k) => {
      const x = k / 512 - 1;
      return enabled ? 0.4 * x + 0.6 * Math.abs(x) : x;
    });
    if (this.#shaper) this.#shaper.curve = curve;
  }

  #report({ time }) {
    const { contextTime, performanceTime } = this.#context.getOutputTimestamp();
    this.onSound(performanceTime + 1000 * (time - contextTime));
  }
}
