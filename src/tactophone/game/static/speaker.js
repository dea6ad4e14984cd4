// Plays the vibration as sound, and by a phone's own motor; reports when sound starts after silence.

const RATE = 48000;
const BUZZ = 50; // ms of a phone's vibration at a time: its motor is not faster
const WEAKEST_BUZZ = 0.02; // of full drive

export class Speaker {
  #context = null;
  #node = null;
  #gain = null;
  #shaper = null;
  #strength = 0;

  /** `onSound(time)`: the first vibration after silence left the loudspeaker at that time of `performance.now()`. */
  constructor(onSound) {
    this.onSound = onSound;
  }

  /** Browsers allow sound only after a button press: call this from its handler. */
  async start() {
    if (this.#context) return this.#context.resume();
    if (navigator.vibrate) setInterval(() => this.#buzz(), BUZZ);
    this.#context = new AudioContext({ sampleRate: RATE, latencyHint: "interactive" });
    await this.#context.audioWorklet.addModule(new URL("./vibration.js", import.meta.url));
    this.#node = new AudioWorkletNode(this.#context, "vibration", { numberOfInputs: 0, outputChannelCount: [1] });
    this.#node.port.addEventListener("message", ({ data }) => this.#report(data));
    this.#node.port.start();
    this.#shaper = new WaveShaperNode(this.#context);
    const noConstant = new BiquadFilterNode(this.#context, { type: "highpass", frequency: 25 });
    this.#gain = new GainNode(this.#context);
    this.#node.connect(this.#shaper).connect(noConstant).connect(this.#gain).connect(this.#context.destination);
  }

  /** Queue samples. */
  play(samples) {
    if (!samples.length) return;
    this.#strength = samples.reduce((greatest, sample) => Math.max(greatest, Math.abs(sample)), 0);
    this.#node?.port.postMessage(samples);
  }

  set volume(value) {
    this.#gain?.gain.setTargetAtTime(2 * value, this.#context.currentTime, 0.02);
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

  #buzz() {
    if (this.#strength > WEAKEST_BUZZ) navigator.vibrate(Math.ceil(BUZZ * Math.min(1, 2 * this.#strength)));
  }
}
