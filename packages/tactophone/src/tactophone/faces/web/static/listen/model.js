// A model file in a browser: docs/reference/model-files.md, in JavaScript. Sound in; a prediction for each window out.

import { joined, Resampler } from "../resampler.js";
import { Touch } from "./touch.js";

/** The card of a model file: the entry of its metadata, which the runtime for browsers does not read. */
export function readCard(bytes) {
  const text = new TextDecoder();
  for (const [field, entry] of fields(bytes)) {
    if (field !== 14) continue; // metadata_props of ModelProto: pairs of a key and a value
    const { 1: key, 2: value } = Object.fromEntries(fields(entry));
    if (text.decode(key) === "tactophone.card") return JSON.parse(text.decode(value));
  }
  throw new Error("this is no model file of Tactophone: it has no card");
}

function* fields(bytes) {
  let at = 0;
  const varint = () => {
    let value = 0;
    for (let scale = 1; ; scale *= 128) {
      const byte = bytes[at++];
      value += (byte & 127) * scale;
      if (byte < 128) return value;
    }
  };
  while (at < bytes.length) {
    const key = varint(), kind = key & 7;
    const size = kind === 2 ? varint() : kind === 1 ? 8 : kind === 5 ? 4 : 0;
    if (kind === 0) varint();
    yield [Math.floor(key / 8), bytes.subarray(at, at + size)];
    at += size;
  }
}

const LEVELS = {
  rms: () => (window) => Math.sqrt(mean(window, (x) => x * x)),
  mean_absolute: () => (window) => mean(window, Math.abs),
  banded,
};

const mean = (window, of) => window.reduce((sum, x) => sum + of(x), 0) / window.length;

/**
 * Level between 1/32 and 1/2 of the Nyquist frequency: a DFT of those bins alone, with a periodic Hann window. Its real
 * part depends on x[n] + x[size - n] alone, the imaginary one on their difference; x[0] is 0 after the taper.
 */
function banded(size) {
  const half = Math.floor(size / 2), lowest = Math.floor(size / 64), highest = Math.floor(size / 4);
  const turn = (2 * Math.PI) / size, weights = size % 2 ? 1 : 0.5; // the middle sample is its own partner
  const [cosines, sines] = [Math.cos, Math.sin].map((of) =>
    Float64Array.from({ length: (highest - lowest) * half }, (_, k) => {
      const bin = lowest + Math.floor(k / half), n = (k % half) + 1;
      return of(turn * ((bin * n) % size)) * (n === half ? weights : 1) * (0.5 - 0.5 * Math.cos(turn * n));
    }));
  const [sums, differences] = [new Float64Array(half), new Float64Array(half)];
  return (window) => {
    for (let n = 1; n <= half; n++) {
      sums[n - 1] = window[n] + window[size - n];
      differences[n - 1] = window[n] - window[size - n];
    }
    let power = 0;
    for (let row = 0; row < cosines.length; row += half) {
      let real = 0, imaginary = 0;
      for (let n = 0; n < half; n++) {
        real += sums[n] * cosines[row + n];
        imaginary += differences[n] * sines[row + n];
      }
      power += real * real + imaginary * imaginary;
    }
    return Math.sqrt((16 * power) / (3 * size * size));
  };
}

const dbfs = (amplitude) => (amplitude > 0 ? Math.max(-200, Math.round(20e6 * Math.log10(amplitude)) / 1e6) : -200);

const RUNTIME = "ort.wasm.bundle.min.mjs";
const BINARY = "ort-wasm-simd-threaded.wasm.gz";

/** The bytes of a file, unpacked where it is still packed: some servers unpack it on the way. */
async function fetched(address) {
  const answer = await fetch(address);
  if (!answer.ok) throw new Error(`${address.pathname.split("/").pop()} is missing beside this page`);
  const bytes = new Uint8Array(await answer.arrayBuffer());
  if (bytes[0] !== 0x1f || bytes[1] !== 0x8b) return bytes;
  const unpacked = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(unpacked).arrayBuffer());
}

/** A model file, loaded and ready to run. */
export class Model {
  /** `address`: of the model file; `runtime`: of the folder with ONNX Runtime. */
  static async open(address, runtime) {
    const [ort, binary, bytes] = await Promise.all([import(new URL(RUNTIME, runtime)), fetched(new URL(BINARY, runtime)), fetched(address)]);
    ort.env.wasm.numThreads = 1; // more need headers that a static site does not send
    ort.env.wasm.wasmBinary = binary.buffer;
    const card = readCard(bytes);
    if (card.channels !== 1) throw new Error(`the model ${card.name} needs ${card.channels} microphones; choose one for one`);
    return new Model(ort, card, await ort.InferenceSession.create(bytes));
  }

  constructor(ort, card, session) {
    Object.assign(this, { ort, card, session });
  }
}

/** A model that listens to one microphone. */
export class Detector {
  /** `rate`: of the sound to come, in Hz. */
  constructor({ ort, card, session }, rate) {
    Object.assign(this, { ort, card, session, rate });
    this.thresholdDbfs = card.gate.threshold_dbfs;
    [this.hopUp, this.hopDown] = String(card.hop).split("/").map(Number).concat(1);
    this.levelOf = LEVELS[card.gate.rule](card.window_size);
    this.reset();
  }

  /** Seconds between two predictions. */
  get hop() { return this.hopUp / this.hopDown / this.card.sample_rate; }

  /** Forget everything: the sound to come, from that time in s on, has nothing to do with what came. */
  reset(start = 0) {
    this.start = start;
    this.resampler = new Resampler(this.rate, this.card.sample_rate);
    this.touch = new Touch(this.card);
    this.state = null;
    this.kept = new Float32Array(0);
    this.first = this.count = 0;
  }

  /** Take sound; return a prediction for each window that it completes. Await it before the next call. */
  async push(samples) {
    this.kept = joined(this.kept, this.resampler.push(samples));
    const size = this.card.window_size, predictions = [];
    for (;;) {
      const end = size + Math.floor((this.count * this.hopUp) / this.hopDown);
      if (end > this.first + this.kept.length) break;
      const start = end - size - this.first;
      predictions.push(await this.#predict(this.kept.slice(start, start + size), end));
      this.count += 1;
      this.kept = this.kept.slice(start);
      this.first += start;
    }
    return predictions;
  }

  async #predict(window, end) {
    const level = dbfs(this.levelOf(window)), contact = level >= this.thresholdDbfs;
    const { Tensor } = this.ort, feeds = { sound: new Tensor("float32", window, [1, 1, window.length]) };
    if (this.session.inputNames.includes("state")) {
      feeds.contact = new Tensor("float32", [contact ? 1 : 0], [1]);
      feeds.state = this.state ?? this.#noState();
    }
    const { log_probabilities: logs, features, state_out: state } = await this.session.run(feeds);
    this.state = state;
    const heard = { probabilities: Array.from(logs.data, Math.exp), features: features?.data, level, end: this.start + end / this.card.sample_rate };
    return { end: heard.end, level, contact, ...this.touch.push(heard, this.thresholdDbfs) };
  }

  #noState() {
    const { shape } = this.session.inputMetadata.find(({ name }) => name === "state");
    return new this.ort.Tensor("float64", new Float64Array(shape[1]), [1, shape[1]]);
  }
}
