// SPDX-License-Identifier: Apache-2.0
// The files of the package that the player loads, next to its script.

/** Creates the worker that fetches and decodes a scene. */
export function createWorker(): Worker {
  return new Worker(new URL("./stgs-worker.js", import.meta.url), { type: "module", name: "stgs" });
}

/** The URL of the worker that sorts. */
export function sorterUrl(): URL {
  return new URL("./stgs-sorter.js", import.meta.url);
}
