// The vibration as sound, and as a phone's own vibration; tells when the first of it was heard.

const RATE = 48000;
const BUZZ = 50; // ms of a phone's vibration at a time: its motor is no faster
const WEAKEST_BUZZ = 0.02; // of full drive

export class Speaker {
  #context = null;
  #node = null;
  #gain = null;
  #shaper = null;
  #strength = 0;

  /** `onHeard(time)`: the first vibration after silence left the loudspeaker at that time of `performance.now()`. */
  constructor(onHeard) {
    this.onHeard = onHeard;
  }

  /** Browsers give sound only after a press of a button: call this from one. */
  async start() {
    if (this.#context) return this.#context.resume();
    if (navigator.vibrate) setInterval(() => this.#buzz(), BUZZ);
    this.#context = new AudioContext({ sampleRate: RATE, latencyHint: "interactive" });
    await this.#context.audioWorklet.addModule(new URL("./vibration.js", import.meta.url));
    this.#node = new AudioWorkletNode(this.#context, "vibration", { numberOfInputs: 0, outputChannelCount: [1] });
    this.#node.port.addEventListener("message", ({ data }) => this.#hear(data));
    this.#node.port.start();
    this.#shaper = new WaveShaperNode(this.#context);
    const noConstant = new BiquadFilterNode(this.#context, { type: "highpass", frequency: 25 });
    this.#gain = new GainNode(this.#context);
    this.#node.connect(this.#shaper).connect(noConstant).connect(this.#gain).connect(this.#context.destination);
  }

  /** Play samples when those before them are over. */
  play(samples) {
    if (!samples.length) return;
    this.#strength = samples.reduce((greatest, sample) => Math.max(greatest, Math.abs(sample)), 0);
    this.#node?.port.postMessage(samples);
  }

  set volume(value) {
    this.#gain?.gain.setTargetAtTime(2 * value, this.#context.currentTime, 0.02);
  }

  /** Small loudspeakers cannot give 60 Hz: full-wave rectification adds the octaves over it, at any strength. */
  set overtones(wanted) {
    const curve = Float32Array.from({ length: 1025 }, (_, k) => {
      const x = k / 512 - 1;
      return wanted ? 0.4 * x + 0.6 * Math.abs(x) : x;
    });
    if (this.#shaper) this.#shaper.curve = curve;
  }

  #hear({ time }) {
    const { contextTime, performanceTime } = this.#context.getOutputTimestamp();
    this.onHeard(performanceTime + 1000 * (time - contextTime));
  }

  #buzz() {
    if (this.#strength > WEAKEST_BUZZ) navigator.vibrate(Math.ceil(BUZZ * Math.min(1, 2 * this.#strength)));
  }
}
