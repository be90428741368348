// Opens a log with Foxglove's own MCAP reader for JavaScript, as its app does, and checks every message.
//
//   npm install --prefix /tmp/reader @mcap/core@2 @mcap/nodejs@1 @mcap/support@1
//   NODE_PATH=/tmp/reader/node_modules node benchmarks/program/open_with_foxglove_reader.mjs runs/first/run.mcap

import { open } from "node:fs/promises";
import { createRequire } from "node:module";

const load = createRequire(process.env.NODE_PATH + "/");
const { McapIndexedReader } = load("@mcap/core");
const { FileHandleReadable } = load("@mcap/nodejs");
const { loadDecompressHandlers } = load("@mcap/support");

const file = await open(process.argv[2]);
const readable = new FileHandleReadable(file);
const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers: await loadDecompressHandlers() });
const counts = new Map();
for await (const message of reader.readMessages()) {
  const channel = reader.channelsById.get(message.channelId), schema = reader.schemasById.get(channel.schemaId);
  const named = JSON.parse(new TextDecoder().decode(schema.data)).properties;
  const record = JSON.parse(new TextDecoder().decode(message.data));
  if (named) for (const key of Object.keys(record)) if (!(key in named)) throw new Error(`${channel.topic}.${key} is not in ${schema.name}`);
  const row = counts.get(channel.topic) ?? { topic: channel.topic, schema: schema.name, fields: Object.keys(named ?? {}).length, messages: 0 };
  row.messages += 1;
  counts.set(channel.topic, row);
}
console.table([...counts.values()]);
const { messageCount, chunkCount, schemaCount, attachmentCount } = reader.statistics;
console.log(`${messageCount} messages in ${chunkCount} indexed chunks, ${schemaCount} schemas, ${attachmentCount} attachments`);
await file.close();
