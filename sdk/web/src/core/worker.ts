// SPDX-License-Identifier: Apache-2.0
// The worker of a player: an entry point of its own, bundled to stgs-worker.js.
import type { CoreMessage, PageMessage } from "../types";
import { PlayerHost } from "./player_host";

/** The part of DedicatedWorkerGlobalScope that is used. */
interface Scope {
  onmessage: ((event: MessageEvent<PageMessage>) => void) | null;
  postMessage(message: CoreMessage, transfer: Transferable[]): void;
}

/** Compiles the module, which lies next to this script. */
async function compile(): Promise<WebAssembly.Module> {
  const url = new URL("./stgs-core.wasm", import.meta.url);
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url.pathname}: status ${response.status}; copy stgs-core.wasm next to stgs-worker.js`);
  return WebAssembly.compile(await response.arrayBuffer());
}

const scope = self as unknown as Scope;
const host = new PlayerHost(compile(), (message, transfer) => scope.postMessage(message, transfer));
scope.onmessage = ({ data }) => host.handle(data);
