// A client of Foxglove's websocket protocol, their own: it subscribes to everything and prints each message as a line of
// JSON, until the server closes. `node foxglove_client.mjs ADDRESS`; used by the tests of `--live`.
import protocol from "@foxglove/ws-protocol";
import { WebSocket } from "ws";

// The protocol was renamed when its server moved into their SDK; what it says is the same.
const client = new protocol.FoxgloveClient({ ws: new WebSocket(process.argv[2], ["foxglove.sdk.v1"]) });
const channels = new Map();
client.on("error", (error) => { console.error(String(error.message ?? error)); process.exit(1); });
client.on("close", () => process.exit(0));
client.on("advertise", (added) => {
  for (const channel of added) channels.set(client.subscribe(channel.id), channel);
});
client.on("message", ({ subscriptionId, timestamp, data }) => {
  const { topic, schemaName, encoding } = channels.get(subscriptionId);
  const bytes = Buffer.from(data.buffer, data.byteOffset, data.byteLength).toString("base64");
  console.log(JSON.stringify({ topic, schemaName, encoding, timestamp: String(timestamp), bytes }));
});
