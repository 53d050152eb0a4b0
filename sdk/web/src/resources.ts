// SPDX-License-Identifier: Apache-2.0
// The files of the package that the player loads: by default those next to its script.
import { OPEN_BYTES, rangeReader, ReadError } from "./core/range_reader";
import { textOf } from "./player/errors";
import type { StartMessage } from "./types";
import { workerUrl } from "./worker_url";

/** The files, where they do not lie next to the script. */
export interface Resources {
  worker: string;    // URL of stgs-worker.js
  sorter: string;    // URL of stgs-sorter.js
  core: ArrayBuffer; // content of stgs-core.wasm
}

let replaced: Resources | null = null;

/**
 * Uses these files instead of those next to the script, as in a page of one file. Call before the
 * first player is created. They must be of the same version as the script. `stgs`, `stgs/three` and
 * `stgs/playcanvas` are separate scripts: each has a function of its own, which applies to its players only.
 */
export function setResources(resources: Resources): void {
  replaced = resources;
}

let core: Promise<WebAssembly.Module> | null = null; // compiled once for all players

async function compile(): Promise<WebAssembly.Module> {
  if (replaced !== null) return WebAssembly.compile(replaced.core);
  const url = new URL("./stgs-core.wasm", import.meta.url);
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url.pathname}: status ${response.status}; copy stgs-core.wasm next to the script`);
  // Compiles during the download, which needs the right type.
  if (response.headers.get("Content-Type") === "application/wasm") return WebAssembly.compileStreaming(response);
  return WebAssembly.compile(await response.arrayBuffer());
}

/** Passes the core to a worker once it is compiled, or the reason if compiling fails. */
function provideCore(worker: Worker): void {
  const send = (message: StartMessage) => worker.postMessage(message);
  core ??= compile();
  core.then(
    (module) => send({ type: "core", module }),
    (error: unknown) => {
      core = null; // the next player tries again
      send({ type: "core", problem: textOf(error) });
    });
}

/** Returns a signal that is aborted when a worker is terminated. */
function endOf(worker: Worker): AbortSignal {
  const end = new AbortController();
  worker.terminate = () => {
    end.abort();
    Worker.prototype.terminate.call(worker);
  };
  return end.signal;
}

/**
 * Starts reading a source for a worker, so that the read does not wait for the worker to start. Terminating
 * the worker aborts the read.
 */
function provideStart(worker: Worker, source: string): void {
  const send = (message: StartMessage) => worker.postMessage(message);
  send({ type: "expect", source });
  rangeReader(source).readStart(OPEN_BYTES, endOf(worker)).then(
    (start) => send({ type: "start", start }),
    (error: unknown) => {
      const isFinal = error instanceof ReadError && !error.retry && error.code !== "aborted";
      send({ type: "start", start: isFinal ? { problem: error.message, code: error.code } : null });
    });
}

/**
 * Creates the worker that fetches and decodes a scene. `source`: the absolute URL or Blob that will be
 * opened next, if known.
 */
export function createWorker(source?: string | Blob): Worker {
  // Bundlers recognise this form of URL.
  const script = replaced === null ? new URL("./stgs-worker.js", import.meta.url) : new URL(replaced.worker, document.baseURI);
  const worker = new Worker(workerUrl(script), { type: "module", name: "stgs" });
  provideCore(worker);
  if (typeof source === "string") provideStart(worker, source);
  return worker;
}

/** The URL of the worker that sorts. */
export function sorterUrl(): URL {
  return replaced === null ? new URL("./stgs-sorter.js", import.meta.url) : new URL(replaced.sorter, document.baseURI);
}
