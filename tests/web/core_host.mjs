// SPDX-License-Identifier: Apache-2.0
// The core in node: its worker, its decoders and a file on a server, without a browser.
import { readFileSync } from "node:fs";
import { importSource } from "./import_source.mjs";

const { PlayerHost } = await importSource("src/core/player_host.ts");
const { decoderWorker } = await importSource("src/core/part_decoder.ts");

globalThis.navigator ??= { hardwareConcurrency: 2 };

export const delay = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

const served = new Map(); // by URL
globalThis.fetch = (url, options) => served.get(url).fetch(options);

/** A file behind fetch(): the first `size` of `bytes`. Its ETag changes with its size. */
export class ServedFile {
  reads = []; // { offset, bytes, cache, time }
  fails = null; // (read) => whether the connection fails
  version = "a";

  constructor(bytes, size = bytes.length) {
    this.bytes = bytes;
    this.size = size;
    this.url = `http://host/${served.size}/scene.stgs`;
    served.set(this.url, this);
  }

  async fetch({ headers, signal, cache }) {
    const [, first, last] = /^bytes=(\d+)-(\d+)$/.exec(headers.Range).map(Number);
    const read = { offset: first, bytes: last + 1 - first, cache, time: performance.now() };
    this.reads.push(read);
    await delay(1);
    if (signal.aborted) throw new Error("aborted");
    if (this.fails?.(read)) throw new TypeError("failed to fetch");
    if (first >= this.size) return new Response("", { status: 416 });
    const end = Math.min(last + 1, this.size);
    return new Response(this.bytes.subarray(first, end), {
      status: 206,
      headers: { "Content-Range": `bytes ${first}-${end - 1}/${this.size}`, ETag: `"${this.version}${this.size}"` },
    });
  }

  get bytesRead() {
    return this.reads.reduce((sum, { bytes }) => sum + bytes, 0);
  }
}

class DecoderThread {
  onmessage = null;
  handle = decoderWorker((data) => this.onmessage?.({ data }));
  postMessage(request) {
    this.handle(request);
  }
  terminate() {
    this.onmessage = null;
  }
}

/** A core with the messages that it has posted. */
export class CoreRun {
  messages = [];
  lastSeek = 0;
  openedAt = 0; // time of the message

  constructor(wasm) {
    const module = WebAssembly.compile(readFileSync(wasm));
    this.host = new PlayerHost(module, () => new DecoderThread(), (message) => this.receive(message));
  }
  receive(message) {
    if (message.type === "opened") this.openedAt = performance.now();
    this.messages.push(message);
  }
  send(message) {
    this.host.handle(message);
  }
  /** Opens a served file. Returns its description. */
  async open(file, options = {}) {
    this.send({ type: "open", source: file.url, options: { memoryBudget: 2 ** 28, maxPrimitives: Infinity, lookAhead: 10, latency: 1, ...options } });
    return (await this.message("opened")).info;
  }
  /** Seeks, and returns the state at that time once its data is there. */
  async seek(seconds) {
    const id = ++this.lastSeek;
    this.send({ type: "seek", seconds, id });
    return this.until((state) => state.seek >= id && state.layers === state.layerCount);
  }
  all(type) {
    return this.messages.filter((message) => message.type === type);
  }
  get state() {
    return this.all("state").pop();
  }
  /** Waits for a message of a type. */
  async message(type) {
    await this.wait(() => this.all(type).length > 0, type);
    return this.all(type).pop();
  }
  /** Waits for a state. */
  async until(condition) {
    await this.wait(() => this.state !== undefined && condition(this.state), condition);
    return this.state;
  }
  async wait(condition, what) {
    const end = Date.now() + 20_000;
    while (!condition()) {
      const [error] = this.all("error");
      if (error !== undefined && what !== "error") throw new Error(error.message);
      if (Date.now() > end) throw new Error(`no ${what}; the last state is ${JSON.stringify(this.state)}`);
      await delay(5);
    }
  }
  close() {
    this.send({ type: "close" });
  }
}
