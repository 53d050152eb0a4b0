// SPDX-License-Identifier: Apache-2.0
// The worker of a player, and the workers in which it decodes: an entry point of its own, bundled to
// stgs-worker.js.
import type { CoreBytes, CoreMessage, PageMessage } from "../types";
import type { DecoderThread } from "./decoder_pool";
import { decoderWorker } from "./part_decoder";
import type { DecoderReply, DecoderRequest } from "./part_decoder";
import { PlayerHost } from "./player_host";

/** The part of DedicatedWorkerGlobalScope that is used. */
interface Scope<Received, Sent> {
  readonly name: string;
  readonly location: { href: string };
  onmessage: ((event: MessageEvent<Received>) => void) | null;
  postMessage(message: Sent, transfer: Transferable[]): void;
}

/** The name of a decoding worker. */
const DECODER = "stgs decoder";

/** Compiles the module, which lies next to this script. */
async function compile(): Promise<WebAssembly.Module> {
  const url = new URL("./stgs-core.wasm", import.meta.url);
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url.pathname}: status ${response.status}; copy stgs-core.wasm next to stgs-worker.js`);
  return WebAssembly.compile(await response.arrayBuffer());
}

function runDecoder(scope: Scope<DecoderRequest, DecoderReply>): void {
  const handle = decoderWorker((reply, transfer) => scope.postMessage(reply, transfer));
  scope.onmessage = ({ data }) => handle(data);
}

function runPlayer(scope: Scope<PageMessage | CoreBytes, CoreMessage>): void {
  const startDecoder = (): DecoderThread => new Worker(scope.location.href, { type: "module", name: DECODER });
  const start = (module: Promise<WebAssembly.Module>) =>
    new PlayerHost(module, startDecoder, (message, transfer) => scope.postMessage(message, transfer));
  let host: PlayerHost | null = null; // from the first message on
  scope.onmessage = ({ data }) => {
    if (data.type === "core") {
      host = start(WebAssembly.compile(data.bytes));
    } else {
      host ??= start(compile());
      host.handle(data);
    }
  };
}

const scope: unknown = self;
if ((scope as { name: string }).name === DECODER) runDecoder(scope as Scope<DecoderRequest, DecoderReply>);
else runPlayer(scope as Scope<PageMessage | CoreBytes, CoreMessage>);
