// The page that listens: the device's microphone, unprocessed, to the run.

import { NO_RETRY, socketTo } from "./feed.js";
import { Resampler } from "./resampler.js";

const RATE = 48000; // Hz, of the sound that is sent
const MOST = 960; // samples of a message, 20 ms: the server refuses longer ones
const MOST_QUEUED = 40000; // bytes, 0.2 s: on a slow network sound is dropped rather than sent late
const RAW = { channelCount: 1, echoCancellation: false, noiseSuppression: false, autoGainControl: false };

const REASONS = {
  NotAllowedError: "The browser refused the microphone: allow it for this page, beside the address, and try again.",
  NotFoundError: "This device has no microphone: connect one, and try again.",
  NotReadableError: "The microphone is in use by another program: close that, and try again.",
};

export class Microphone {
  #stream = null;
  #context = null;
  #socket = null;

  /** `onState(text, live)`. */
  constructor({ onState }) {
    this.onState = onState;
    addEventListener("pagehide", () => this.stop());
  }

  get on() { return this.#stream !== null; }

  /** Start, from a button's handler. */
  async start() {
    if (!navigator.mediaDevices?.getUserMedia) {
      return this.onState("A browser gives the microphone only to a secure address: start again with --https, or use a page on the machine itself.", false);
    }
    try {
      this.#stream = await navigator.mediaDevices.getUserMedia({ audio: RAW, video: false });
      await this.#connect();
    } catch (error) {
      this.stop(REASONS[error.name] ?? `The microphone cannot be used: ${error.message}`);
    }
  }

  stop(reason = "") {
    this.#stream?.getTracks().forEach((track) => track.stop());
    this.#socket?.close();
    this.#context?.close();
    this.#stream = this.#context = this.#socket = null;
    this.onState(reason, false);
  }

  async #connect() {
    const socket = socketTo("listen");
    this.#socket = socket;
    socket.addEventListener("close", ({ code, reason }) => {
      if (this.#socket === socket) this.stop(reason || (code === NO_RETRY ? "" : "The run has ended, or takes no microphone from a page."));
    });
    // At the device's own rate: beside a microphone of another rate Firefox refuses to open.
    this.#context = new AudioContext({ latencyHint: 0 });
    await this.#context.audioWorklet.addModule(new URL("./capture.js", import.meta.url));
    const node = new AudioWorkletNode(this.#context, "capture", { numberOfOutputs: 0, channelCount: 1, channelCountMode: "explicit" });
    const messages = new Messages(this.#context.sampleRate);
    node.port.onmessage = ({ data }) => {
      for (const message of messages.of(new Float32Array(data, 4))) {
        if (socket.proven && socket.readyState === WebSocket.OPEN && socket.bufferedAmount < MOST_QUEUED) socket.send(message);
      }
    };
    this.#context.createMediaStreamSource(this.#stream).connect(node);
    this.onState("This microphone is live: it is sent to the run as long as this page is open.", true);
  }
}

/** Sound of a device, as the messages of uint32 position and float32 samples at `RATE` that the server takes. */
class Messages {
  #position = 0;

  constructor(rate) {
    this.resampler = new Resampler(rate, RATE);
  }

  *of(heard) {
    const samples = this.resampler.push(heard);
    for (let start = 0; start < samples.length; start += MOST) {
      const piece = samples.subarray(start, start + MOST);
      const message = new ArrayBuffer(4 + 4 * piece.length);
      new DataView(message).setUint32(0, this.#position, true);
      new Float32Array(message, 4).set(piece);
      this.#position = (this.#position + piece.length) >>> 0;
      yield message;
    }
  }
}
