// SPDX-License-Identifier: Apache-2.0
// The files of the package that the player loads: by default those next to its script.
import type { CoreBytes } from "./types";

/** The files, where they do not lie next to the script. */
export interface Resources {
  worker: string;    // URL of stgs-worker.js
  sorter: string;    // URL of stgs-sorter.js
  core: ArrayBuffer; // content of stgs-core.wasm
}

let replaced: Resources | null = null;

/**
 * Uses these files instead of those next to the script, as in a page of one file. Call before the
 * first player is created. They must be of the same version as the script.
 */
export function setResources(resources: Resources): void {
  replaced = resources;
}

/** Creates the worker that fetches and decodes a scene. */
export function createWorker(): Worker {
  // Bundlers need the literals in place.
  if (replaced === null) return new Worker(new URL("./stgs-worker.js", import.meta.url), { type: "module", name: "stgs" });
  const worker = new Worker(replaced.worker, { type: "module", name: "stgs" });
  const message: CoreBytes = { type: "core", bytes: replaced.core };
  worker.postMessage(message);
  return worker;
}

/** The URL of the worker that sorts. */
export function sorterUrl(): URL {
  return replaced === null ? new URL("./stgs-sorter.js", import.meta.url) : new URL(replaced.sorter, document.baseURI);
}
