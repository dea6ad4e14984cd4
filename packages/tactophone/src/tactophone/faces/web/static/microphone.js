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
  #session = null; // from the press on: its stream, context and socket once there are any

  /** `onState(text, live)`. */
  constructor({ onState }) {
    this.onState = onState;
    addEventListener("pagehide", () => this.stop());
  }

  get on() { return this.#session !== null; }

  /** Start, from a button's handler; another press while the browser asks changes nothing. */
  async start() {
    if (this.on) return;
    if (!navigator.mediaDevices?.getUserMedia) {
      return this.onState("A browser gives the microphone only to a secure address: start again with --https, or use a page on the machine itself.", false);
    }
    const session = (this.#session = {});
    try {
      const stream = await navigator.mediaDevices.getUserMedia({ audio: RAW, video: false });
      if (this.#session !== session) return end(stream); // stopped while the browser asked
      session.stream = stream;
      await this.#connect(session);
    } catch (error) {
      if (this.#session === session) this.stop(REASONS[error.name] ?? `The microphone cannot be used: ${error.message}`);
    }
  }

  stop(reason = "") {
    const session = this.#session ?? {};
    this.#session = null;
    end(session.stream);
    session.socket?.close();
    session.context?.close();
    this.onState(reason, false);
  }

  async #connect(session) {
    const socket = socketTo("listen");
    session.socket = socket;
    socket.addEventListener("close", ({ code, reason }) => {
      if (this.#session === session) this.stop(reason || (code === NO_RETRY ? "" : "The run has ended, or takes no microphone from a page."));
    });
    // At the device's own rate: beside a microphone of another rate Firefox refuses to open.
    session.context = new AudioContext({ latencyHint: 0 });
    await session.context.audioWorklet.addModule(new URL("./capture.js", import.meta.url));
    if (this.#session !== session) return;
    const node = new AudioWorkletNode(session.context, "capture", { numberOfOutputs: 0, channelCount: 1, channelCountMode: "explicit" });
    const messages = new Messages(session.context.sampleRate);
    node.port.onmessage = ({ data }) => {
      for (const message of messages.of(new Float32Array(data, 4))) {
        if (socket.proven && socket.readyState === WebSocket.OPEN && socket.bufferedAmount < MOST_QUEUED) socket.send(message);
      }
    };
    session.context.createMediaStreamSource(session.stream).connect(node);
    this.onState("This microphone is live: it is sent to the run as long as this page is open.", true);
  }
}

function end(stream) {
  stream?.getTracks().forEach((track) => track.stop());
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
