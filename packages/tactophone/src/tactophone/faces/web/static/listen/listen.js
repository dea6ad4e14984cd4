// The page that listens: the device's microphone in; word, roughness and vibration out. Everything runs on this device.

import { Fingertip } from "../fingertip.js";
import { Hero } from "../hero.js";
import { Meter } from "../meter.js";
import { Toggle } from "../press.js";
import { joined } from "../resampler.js";
import { listenForStop } from "../stop.js";
import { dbfs, foldOnPhone, percent, put } from "../text.js";
import { LONGEST, STEP_COLUMNS, Timeline } from "../timeline.js";
import { Track } from "../track.js";
import { Detector, Model } from "./model.js";
import { HIGHEST_CEILING, ROUGH, SMOOTH } from "../../telephone.js"; // app/listen.py writes it

const RAW = { channelCount: 1, echoCancellation: false, noiseSuppression: false, autoGainControl: false };
const REASONS = {
  NotAllowedError: "The browser refused the microphone: allow it for this page, beside the address, and try again.",
  NotFoundError: "This device has no microphone: connect one, and try again.",
  NotReadableError: "The microphone is in use by another program: close that, and try again.",
};
const INSECURE = "A browser gives the microphone only to a secure address: https, or http://localhost.";
const READY = "Press “Use this microphone”.";
const SOUNDS = "You get it as sound: use headphones, or a voice coil on an amplifier.";
const SCRATCH = "Scratch something.";
const NO_TOUCH = "This sounds like speech, rain or typing, not like touch, so rough is not rendered.";
const TASK = "A pen, a key or a fingernail: something hard on something.";
const SETTLE = 0.3; // s until a microphone has settled
const SILENCE = 1; // s that measure its noise
const OVER_NOISE_DB = 3;
const LEAST_DBFS = -120; // no microphone is so quiet
const MOST_BEHIND = 0.5; // s of sound that may wait for the processor; more is dropped
const SMOOTHING = 0.005; // s: time constant of the tone's changes
const DEAD_MAN = 0.1; // s after the last prediction at which the tone ends by itself
const SHOWN = 60; // ms between two pictures
const KEPT = 6000; // predictions kept for whoever asks, a minute
const TOUCHES = ["none", "smooth", "rough"];

const $ = (id) => document.getElementById(id);
/** What was found, newest last. */
export const history = [];

const hero = new Hero($("hero"));
const meter = new Meter($("microphone-meter"), "Level");
const timeline = new Timeline($("timeline"));
const steps = new Track(STEP_COLUMNS, 110 * LONGEST);
const noEvents = new Track(2, 1);

/** The runtime and the model, loaded once, as soon as the page is open. */
let loading = null;

/** Load a model file beside this page. */
export function openModel(name = "model.onnx") {
  const folder = new URL("../../", import.meta.url);
  return Model.open(new URL(name, folder), new URL("../vendor/onnxruntime-web/", import.meta.url));
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
    const { gain, oscillator } = this;
    const now = gain.context.currentTime;
    if (amplitude > 0) oscillator.frequency.setTargetAtTime(frequency, now, SMOOTHING);
    gain.gain.cancelScheduledValues(now);
    gain.gain.setTargetAtTime(amplitude, now, SMOOTHING);
    if (amplitude > 0) gain.gain.setTargetAtTime(0, now + DEAD_MAN, SMOOTHING);
  }
}

/** A run, from the button to Stop. */
class Run {
  #waiting = [];
  #size = 0; // samples that wait
  #working = false;
  #noise = [];
  #heard = 0; // s

  async start() {
    if (!navigator.mediaDevices?.getUserMedia) throw new Error(INSECURE);
    this.context = new AudioContext({ latencyHint: "interactive" });
    this.detector = new Detector(await loading, this.context.sampleRate);
    const given = Number.parseFloat(new URLSearchParams(location.search).get("threshold"));
    this.measured = Number.isFinite(given);
    setThreshold(this.measured ? given : this.detector.card.gate.threshold_dbfs);
    this.tone = new Tone(this.context);
    await this.context.audioWorklet.addModule(new URL("../capture.js", import.meta.url));
    this.node = new AudioWorkletNode(this.context, "capture", { numberOfOutputs: 0, channelCount: 1, channelCountMode: "explicit" });
    this.node.port.onmessage = ({ data }) => this.#take(new Float32Array(data, 4));
    this.stream = await navigator.mediaDevices.getUserMedia({ audio: RAW, video: false });
    this.stream.getTracks()[0].addEventListener("ended", () => stop("The microphone has ended."));
    this.context.createMediaStreamSource(this.stream).connect(this.node);
    await this.context.resume();
    if (this.measured) this.#listen();
    else say("live", "listening", "Keep still for a second: the noise is measured.");
  }

  stop() {
    if (this.node) this.node.port.onmessage = null;
    this.stream?.getTracks().forEach((track) => track.stop());
    this.context?.close();
    this.#waiting = [];
  }

  #listen() {
    this.measured = true;
    say("live", "listening", SCRATCH);
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
        const highest = sound.reduce((most, sample) => Math.max(most, Math.abs(sample)), 0);
        if (sound.length > MOST_BEHIND * this.context.sampleRate) this.detector.reset(this.#heard);
        else for (const found of await this.detector.push(sound)) if (run === this) this.#render(found, highest);
      }
    } catch (error) {
      stop(`The model cannot run here: ${error.message}`);
    } finally {
      this.#working = false;
    }
  }

  #render(found, highest) {
    history.push(found);
    if (history.length > KEPT) history.shift();
    meter.show(found.level, -highest, highest, this.measured ? this.detector.thresholdDbfs : NaN);
    if (!this.measured) return this.#measure(found);
    put($("cause"), found.isTouch ? SCRATCH : NO_TOUCH);
    const felt = vibration(found, ceiling());
    this.tone.play($("way").value === "sound" ? felt : { amplitude: 0 });
    if (fingertip?.on) fingertip.take({ command: [felt.amplitude, found.roughness], ceiling: ceiling(), armed: true, alive: true });
    note(found, felt);
  }

  /** A second of noise gives the threshold; digital silence, as of a muted microphone, gives none. */
  #measure({ end, level }) {
    if (end < SETTLE) return;
    this.#noise.push(level);
    if (end < SETTLE + SILENCE) return;
    const loudest = Math.max(...this.#noise);
    if (loudest > LEAST_DBFS) setThreshold(Math.min(-12, Math.max(-90, loudest + OVER_NOISE_DB)));
    this.#listen();
  }
}

let run = null;
let fingertip = null; // made where a motor is chosen, as it looks for gamepads from then on
let latest = null; // the newest prediction and its vibration, with the time of this page in s

/** Keep a prediction for the pictures. */
function note(found, felt) {
  const { probabilities, touch, level, roughness, unknown, end } = found;
  const numbers = [0, ...probabilities, TOUCHES.indexOf(touch), level, roughness, felt.frequency, felt.amplitude, Number(unknown), -1]; // not labelled
  steps.append({ rows: 1, columns: STEP_COLUMNS, numbers }, end);
  latest = { ...felt, touch: TOUCHES.indexOf(touch), roughness, end, at: performance.now() / 1000 };
}

let drawn = 0; // ms of the newest picture

/** Draw now and then: the processor is the detector's first. */
function draw(time) {
  requestAnimationFrame(draw);
  if (time - drawn < SHOWN) return;
  drawn = time;
  const silence = latest && run ? performance.now() / 1000 - latest.at : 0;
  const lost = !run || !latest || silence > DEAD_MAN;
  hero.show(latest ?? { touch: NaN }, lost, lost);
  timeline.draw((since) => [steps.after(since), noEvents.after(since)], (latest?.end ?? 0) + silence);
}

function chooseWay() {
  const way = $("way").value;
  fingertip?.stop();
  showFelt(way === "sound" ? SOUNDS : "");
  if (!run || !["phone", "gamepad"].includes(way)) return;
  fingertip ??= new Fingertip({ onWay: (text) => { if (text) showFelt(text); }, quiet: true });
  fingertip.choose(way);
  fingertip.start();
}

const ceiling = () => Math.min(HIGHEST_CEILING, $("ceiling").valueAsNumber / 100);

function showFelt(words) {
  put($("felt"), [`At most ${percent(ceiling())} of full drive.`, words].filter(Boolean).join(" "));
}

function say(state, word, cause) {
  $("state").dataset.state = state;
  put($("life"), word);
  put($("cause"), cause);
}

function setThreshold(value) {
  run.detector.thresholdDbfs = value;
  timeline.threshold = value;
  $("threshold").value = value;
  put($("threshold-now"), dbfs(value));
}

function showButtons(listening) {
  microphone.on = listening;
  $("listen").ariaPressed = listening;
  put($("listen"), listening ? "Stop this microphone" : "Use this microphone");
  $("stop").disabled = $("threshold").disabled = !listening;
}

async function start() {
  showButtons(true);
  say("live", "starting", "Allow the microphone, if the browser asks.");
  steps.clear();
  latest = null;
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
function stop(reason = "Nothing is heard or felt.") {
  fingertip?.stop();
  run?.stop();
  run = null;
  meter.clear();
  showButtons(false);
  say("waiting", "stopped", reason);
}

async function load() {
  loading = openModel();
  try {
    const { card } = await loading;
    put($("model-hint"), `Model ${card.name}: it was trained with its microphone on a hard tip. Under another finger its words are a demonstration.`);
    $("listen").disabled = false;
    say("waiting", "ready", READY);
  } catch (error) {
    say("silent", "not loaded", `${error.message}`);
  }
}

put($("task"), TASK);
const microphone = new Toggle($("listen"), { begin: start, end: () => { if (run) stop(); } });
listenForStop($("stop"), (action) => { if (action === "stop") stop(); }, () => ({ stopped: false, armed: false }));
$("threshold").addEventListener("input", ({ target }) => {
  run.measured = true;
  setThreshold(target.valueAsNumber);
});
$("ceiling").addEventListener("input", chooseWay);
$("way").addEventListener("change", chooseWay);
document.addEventListener("visibilitychange", () => { if (document.hidden && run) stop("Stopped, as the page was hidden."); });
addEventListener("pagehide", () => { if (run) stop(); });
foldOnPhone($("no-reaction"));
chooseWay();
load();
requestAnimationFrame(draw);
