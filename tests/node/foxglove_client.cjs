// Foxglove's published client: prints what a server says, and one message of each subscribed topic; node foxglove_client.cjs URL TOPIC...

const { FoxgloveClient } = require("@foxglove/ws-protocol");
const WebSocket = require("ws");

const [url, ...topics] = process.argv.slice(2);
const client = new FoxgloveClient({ ws: new WebSocket(url, [FoxgloveClient.SUPPORTED_SUBPROTOCOL]) });
const subscribed = new Map();
const print = (kind, entries) => console.log(JSON.stringify({ kind, ...entries }));

client.on("error", (error) => print("error", { text: String(error) }));
client.on("serverInfo", ({ name, capabilities }) => print("serverInfo", { name, capabilities }));
client.on("advertise", (channels) => {
  print("advertise", { protocol: FoxgloveClient.SUPPORTED_SUBPROTOCOL, topics: channels.map(({ topic }) => topic) });
  for (const { id, topic } of channels) if (topics.includes(topic)) subscribed.set(client.subscribe(id), topic);
});
client.on("message", ({ subscriptionId, timestamp, data }) => {
  if (!subscribed.has(subscriptionId)) return;
  print("message", { topic: subscribed.get(subscriptionId), time: Number(timestamp) / 1e9, data: JSON.parse(new TextDecoder().decode(data)) });
  subscribed.delete(subscriptionId);
  if (subscribed.size === 0) client.close();
});
client.on("close", () => process.exit(0));
