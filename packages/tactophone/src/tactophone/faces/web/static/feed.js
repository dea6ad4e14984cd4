// The feed: one WebSocket, binary messages in (their layout: feed.py), requests out.

import { PROOF } from "./proof.js"; // views.py writes it

const RETRY = 1000; // ms
const TAKEN = 4001; // close code of views.py: another window took over
const OTHER_VERSION = 4002;
const FOREIGN = "another program answers at this address: the run has ended";
const VERSION = "1"; // of the messages: as in views.py

export const NO_RETRY = 1000; // close code of a socket that the page closed itself

/**
 * Open a WebSocket beside the page, with the version of this page.
 *
 * Its first message must be the secret that came with the page. Until then, and from whoever took over the port of a run
 * that has ended, no message is passed on, and `proven` is false.
 */
export function socketTo(path) {
  const address = new URL(path, location.href);
  address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
  address.searchParams.set("v", VERSION);
  address.searchParams.set("prove", "");
  const socket = new WebSocket(address);
  socket.proven = socket.foreign = false;
  socket.addEventListener("message", (event) => {
    if (socket.proven) return;
    event.stopImmediatePropagation();
    socket.proven = event.data === PROOF;
    if (!socket.proven) {
      socket.foreign = true;
      socket.close();
    }
  });
  return socket;
}

/** Split a message into its header and its tables; a table is {rows, columns, numbers}, row by row. */
export function parse(buffer) {
  const size = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  const tables = {};
  let at = 4 + size;
  for (const [name, [rows, columns = 1]] of Object.entries(header.series)) {
    tables[name] = { rows, columns, numbers: new Float32Array(buffer, at, rows * columns) };
    at += 4 * rows * columns;
  }
  return { header, tables };
}

/** Stay connected to `path` beside the page; each message is acknowledged, and the server sends few ahead of that. */
export class Feed {
  #path;
  #socket = null;
  #closed = false;

  constructor(path, { onMessage, onAnswer, onLost }) {
    this.#path = path;
    this.onMessage = onMessage;
    this.onAnswer = onAnswer;
    this.onLost = onLost;
    this.#connect();
  }

  /** Disconnect for good. */
  close() {
    const socket = this.#socket;
    this.#closed = true;
    if (socket.readyState !== WebSocket.CONNECTING) return socket.close(NO_RETRY);
    socket.addEventListener("open", () => socket.close(NO_RETRY)); // sooner, a browser would complain
  }

  send(request) {
    if (this.#socket.readyState === WebSocket.OPEN) this.#socket.send(JSON.stringify(request));
  }

  #connect(query = "") {
    const socket = socketTo(this.#path + query);
    this.#socket = socket;
    socket.binaryType = "arraybuffer";
    socket.addEventListener("message", ({ data }) => this.#take(data));
    socket.addEventListener("close", ({ code, reason }) => {
      if (this.#closed) return;
      if (socket.foreign) return this.onLost(FOREIGN);
      this.onLost(code === TAKEN ? "opened in another window" : reason || "disconnected");
      if (code !== OTHER_VERSION) setTimeout(() => this.#connect(this.#path.includes("?") ? "&again" : "?again"), RETRY);
    });
  }

  #take(data) {
    if (typeof data === "string") return this.onAnswer(JSON.parse(data));
    this.onMessage(parse(data));
    this.#socket.send("ok");
  }
}
