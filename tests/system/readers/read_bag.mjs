// Reads every message of an MCAP file and prints, as JSON, what test_readers.py compares: by topic the number
// of messages, a digest of their times and values, and the values of the first.

import { createHash } from "node:crypto";
import { open } from "node:fs/promises";

import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import { McapIndexedReader } from "@mcap/core";
import { FileHandleReadable } from "@mcap/nodejs";
import { loadDecompressHandlers } from "@mcap/support";

const NUMBER = new DataView(new ArrayBuffer(8));

/** Bits of a float64, so that nothing is lost on the way through text. */
function bits(value) {
  NUMBER.setFloat64(0, value);
  return NUMBER.getBigUint64(0).toString(16).padStart(16, "0");
}

/** Values of a message in the order of its fields: a line each, numbers by their bits. */
function* values(value, path) {
  if (typeof value === "number") {
    yield `${path}=${bits(value)}`;
  } else if (typeof value === "bigint") {
    yield `${path}=${bits(Number(value))}`;
  } else if (typeof value === "boolean") {
    yield `${path}=${bits(value ? 1 : 0)}`;
  } else if (typeof value === "string") {
    yield `${path}="${value}"`;
  } else if (value instanceof Uint8Array) {
    yield `${path}=bytes ${value.length} ${createHash("sha256").update(value).digest("hex")}`;
  } else if (Array.isArray(value) || ArrayBuffer.isView(value)) {
    yield `${path}=${value.length} elements`;
    for (const [index, item] of value.entries()) {
      yield* values(item, `${path}[${index}]`);
    }
  } else {
    for (const [name, item] of Object.entries(value)) {
      yield* values(item, `${path}.${name}`);
    }
  }
}

const file = await open(process.argv[2], "r");
const mcap = await McapIndexedReader.Initialize({
  readable: new FileHandleReadable(file),
  decompressHandlers: await loadDecompressHandlers(),
});
const topics = {};
const readers = new Map();
for await (const message of mcap.readMessages({ validateCrcs: true })) {
  const channel = mcap.channelsById.get(message.channelId);
  const schema = mcap.schemasById.get(channel.schemaId);
  if (!readers.has(channel.id)) {
    const definitions = parse(new TextDecoder().decode(schema.data), { ros2: true });
    readers.set(channel.id, new MessageReader(definitions));
    topics[channel.topic] = { count: 0, digest: createHash("sha256"), first: [] };
  }
  const lines = [`time=${message.logTime}`, ...values(readers.get(channel.id).readMessage(message.data), "")];
  const topic = topics[channel.topic];
  topic.count += 1;
  topic.digest.update(lines.join("\n") + "\n");
  if (topic.count === 1) {
    topic.first = lines;
  }
}
await file.close();
for (const topic of Object.values(topics)) {
  topic.digest = topic.digest.digest("hex");
}
console.log(JSON.stringify(topics));
