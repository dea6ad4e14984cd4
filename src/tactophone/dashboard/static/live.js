// The feed: one WebSocket, binary messages in (their layout: message.py), requests out.

const RETRY = 1000; // ms
const TAKEN = 4001; // close code of game/server.py: another window took over

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

  constructor(path, { onMessage, onAnswer, onLost }) {
    this.#path = path;
    this.onMessage = onMessage;
    this.onAnswer = onAnswer;
    this.onLost = onLost;
    this.#connect();
  }

  send(request) {
    if (this.#socket.readyState === WebSocket.OPEN) this.#socket.send(JSON.stringify(request));
  }

  #connect(query = "") {
    const address = new URL(this.#path + query, location.href);
    address.protocol = "ws:";
    this.#socket = new WebSocket(address);
    this.#socket.binaryType = "arraybuffer";
    this.#socket.addEventListener("message", ({ data }) => this.#take(data));
    this.#socket.addEventListener("close", ({ code }) => {
      this.onLost(code === TAKEN ? "opened in another window" : "disconnected");
      setTimeout(() => this.#connect("?again"), RETRY);
    });
  }

  #take(data) {
    if (typeof data === "string") return this.onAnswer(JSON.parse(data));
    this.onMessage(parse(data));
    this.#socket.send("ok");
  }
}
