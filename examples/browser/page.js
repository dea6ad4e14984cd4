// The page: the device's microphone in; word, roughness and vibration out. Everything runs on this device.

import * as ort from "./ort.wasm.bundle.min.mjs";
import { Fingertip } from "./fingertip.js";
import { Detector } from "./model.js";
import { joined } from "./resampler.js";
import { HIGHEST_CEILING, ROUGH, SMOOTH } from "./stimuli.js"; // build.py writes it

const RAW = { channelCount: 1, echoCancellation: false, noiseSuppression: false, autoGainControl: false };
const REASONS = {
  NotAllowedError: "The browser refused the microphone: allow it for this page, beside the address, and try again.",
  NotFoundError: "This device has no microphone: connect one, and try again.",
  NotReadableError: "The microphone is in use by another program: close that, and try again.",
};
const [SETTLE, SILENCE, OVER_NOISE_DB] = [0.3, 1, 3]; // s until a microphone has settled, s that measure its noise
const LEAST_DBFS = -120; // no microphone is so quiet
const MOST_BEHIND = 0.5; // s of sound that may wait for the processor; more is dropped
const SHOWN = 100; // ms between two changes of what is shown
const [SMOOTHING, DEAD_MAN] = [0.005, 0.1]; // s: time constant of the tone's changes; without a prediction it ends by itself
const SOUNDS = "You get it as sound: use headphones, or a voice coil on an amplifier.";
const KEPT = 6000; // predictions kept for whoever asks, a minute

const element = (id) => document.getElementById(id);
/** What was found, newest last. */
export const history = [];

ort.env.wasm.numThreads = 1; // more need headers that a static site does not send
ort.env.wasm.wasmPaths = { wasm: new URL("./ort-wasm-simd-threaded.wasm", import.meta.url).href };

/** Open a model for sound of a rate. */
export async function openDetector(rate, name = "stylus.onnx") {
  const answer = await fetch(new URL(name, import.meta.url));
  if (!answer.ok) throw new Error(`${name} is missing beside this page: build it again (examples/browser/build.py)`);
  return Detector.open(ort, new Uint8Array(await answer.arrayBuffer()), rate);
}

/** The vibration of a prediction: amplitude 0 to 1, as limited, and frequency in Hz. */
export function vibration({ touch, roughness }, ceiling) {
  const frequency = SMOOTH.frequency * (ROUGH.frequency / SMOOTH.frequency) ** roughness;
  const level = SMOOTH.dbfs + roughness * (ROUGH.dbfs - SMOOTH.dbfs);
  return { amplitude: touch === "none" ? 0 : Math.min(ceiling, HIGHEST_CEILING) * 10 ** (level / 20), frequency };
}

/** A sine. Each prediction also schedules its end in the audio thread, which no stalled page can hold up. */
class Tone {
  constructor(context) {
    this.oscillator = new OscillatorNode(context);
    this.gain = new GainNode(context, { gain: 0 });
    this.oscillator.connect(this.gain).connect(context.destination);
    this.oscillator.start();
  }

  play({ amplitude, frequency }) {
    const { gain, oscillator } = this, now = gain.context.currentTime;
    if (amplitude > 0) oscillator.frequency.setTargetAtTime(frequency, now, SMOOTHING);
    gain.gain.cancelScheduledValues(now);
    gain.gain.setTargetAtTime(amplitude, now, SMOOTHING);
    if (amplitude > 0) gain.gain.setTargetAtTime(0, now + DEAD_MAN, SMOOTHING);
  }
}

/** A run, from Start to Stop. */
class Run {
  #waiting = [];
  #size = 0; // samples that wait
  #working = false;
  #noise = [];
  #heard = 0; // s
  #shown = 0;

  async start() {
    if (!navigator.mediaDevices?.getUserMedia) throw new Error("A browser gives the microphone only to a secure address: https, or http://localhost.");
    this.context = new AudioContext({ latencyHint: "interactive" });
    this.detector = await openDetector(this.context.sampleRate);
    const { card } = this.detector;
    element("model").textContent = `is ${card.name}, at ${card.sample_rate} Hz in windows of ${card.window_size} samples`;
    const given = Number.parseFloat(new URLSearchParams(location.search).get("threshold"));
    this.measured = Number.isFinite(given);
    setThreshold(this.measured ? given : card.gate.threshold_dbfs);
    this.tone = new Tone(this.context);
    await this.context.audioWorklet.addModule(new URL("./capture.js", import.meta.url));
    this.node = new AudioWorkletNode(this.context, "capture", { numberOfOutputs: 0, channelCount: 1, channelCountMode: "explicit" });
    this.node.port.onmessage = ({ data }) => this.#take(new Float32Array(data, 4));
    this.stream = await navigator.mediaDevices.getUserMedia({ audio: RAW, video: false });
    this.stream.getTracks()[0].addEventListener("ended", () => stop("The microphone has ended."));
    this.context.createMediaStreamSource(this.stream).connect(this.node);
    await this.context.resume();
    status(this.measured ? "Listening: scratch something." : "Keep still for a second: the noise is measured.");
  }

  stop() {
    if (this.node) this.node.port.onmessage = null;
    this.stream?.getTracks().forEach((track) => track.stop());
    this.context?.close();
    this.#waiting = [];
  }

  /** Sound that arrives while the model runs waits, and is then taken at once. */
  async #take(samples) {
    this.#waiting.push(samples);
    this.#size += samples.length;
    if (this.#working || this.#size < this.detector.hop * this.context.sampleRate) return;
    this.#working = true;
    try {
      while (this.#waiting.length) {
        this.#size = 0;
        const sound = this.#waiting.splice(0).reduce(joined);
        this.#heard += sound.length / this.context.sampleRate;
        if (sound.length > MOST_BEHIND * this.context.sampleRate) this.detector.reset(this.#heard);
        else for (const found of await this.detector.push(sound)) if (run === this) this.#render(found);
      }
    } catch (error) {
      stop(`The model cannot run here: ${error.message}`);
    } finally {
      this.#working = false;
    }
  }

  #render(found) {
    history.push(found);
    if (history.length > KEPT) history.shift();
    if (!this.measured) return this.#measure(found);
    const felt = vibration(found, ceiling()), way = element("way").value;
    this.tone.play(way === "sound" ? felt : { amplitude: 0 });
    if (fingertip?.on) fingertip.take({ command: [felt.amplitude, found.roughness], ceiling: ceiling(), armed: true, alive: true });
    if (performance.now() - this.#shown >= SHOWN) this.#show(found);
  }

  #show({ touch, roughness, level }) {
    this.#shown = performance.now();
    element("word").textContent = touch === "none" ? "no contact" : touch;
    element("word").dataset.touch = touch;
    element("roughness").value = roughness;
    element("level").value = level;
  }

  /** A second of noise gives the threshold; digital silence, as of a muted microphone, gives none. */
  #measure({ end, level }) {
    if (end < SETTLE) return;
    this.#noise.push(level);
    if (end < SETTLE + SILENCE) return;
    this.measured = true;
    const loudest = Math.max(...this.#noise);
    if (loudest > LEAST_DBFS) setThreshold(Math.min(-12, Math.max(-90, loudest + OVER_NOISE_DB)));
    status("Listening: scratch something.");
  }
}

let run = null;
let fingertip = null; // made where a motor is chosen, as it looks for gamepads from then on

function chooseWay() {
  const way = element("way").value, motor = way === "phone" || way === "gamepad";
  fingertip?.stop();
  element("felt").textContent = way === "sound" ? SOUNDS : "";
  if (!run || !motor) return;
  fingertip ??= new Fingertip({ onWay: (text) => { if (text) element("felt").textContent = text; }, quiet: true });
  fingertip.choose(way);
  fingertip.start();
}

const ceiling = () => Math.min(HIGHEST_CEILING, element("ceiling").valueAsNumber / 100);
const status = (text) => { element("status").textContent = text; };

function setThreshold(dbfs) {
  run.detector.thresholdDbfs = dbfs;
  element("threshold").value = dbfs;
  element("threshold-value").textContent = `${dbfs.toFixed(0)} dBFS`;
}

async function start() {
  element("start").disabled = true;
  element("stop").disabled = element("threshold").disabled = false;
  status("Loading the model, once: 4 MB.");
  const mine = (run = new Run());
  chooseWay();
  try {
    await mine.start();
    if (run !== mine) mine.stop(); // Stop was pressed meanwhile
  } catch (error) {
    mine.stop();
    if (run === mine) stop(REASONS[error.name] ?? error.message);
  }
}

/** Silence everything at once. */
function stop(reason = "Stopped.") {
  fingertip?.stop();
  run?.stop();
  run = null;
  element("start").disabled = false;
  element("stop").disabled = element("threshold").disabled = true;
  element("word").textContent = "–";
  element("word").dataset.touch = "none";
  element("roughness").value = 0;
  status(reason);
}

element("start").addEventListener("click", start);
element("stop").addEventListener("click", () => stop());
element("threshold").addEventListener("input", ({ target }) => {
  run.measured = true;
  setThreshold(target.valueAsNumber);
});
element("ceiling").addEventListener("input", () => { element("ceiling-value").textContent = `${100 * ceiling()} % of full drive`; });
element("way").addEventListener("change", chooseWay);
document.addEventListener("visibilitychange", () => { if (document.hidden && run) stop("Stopped, as the page was hidden."); });
addEventListener("pagehide", () => stop());
