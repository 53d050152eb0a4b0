// SPDX-License-Identifier: Apache-2.0
// The worker of a player, and the workers in which it decodes: an entry point of its own, bundled to
// stgs-worker.js.
import type { CoreMessage, FileStart, PageMessage, ReadFailure, StartMessage } from "../types";
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

function runDecoder(scope: Scope<DecoderRequest, DecoderReply>): void {
  const handle = decoderWorker((reply, transfer) => scope.postMessage(reply, transfer));
  scope.onmessage = ({ data }) => handle(data);
}

function runPlayer(scope: Scope<PageMessage | StartMessage, CoreMessage>): void {
  // The URL is that of a Blob if the script is of another origin than the page (workerUrl()).
  const startDecoder = (): DecoderThread => new Worker(scope.location.href, { type: "module", name: DECODER });
  let provideModule: (message: Extract<StartMessage, { type: "core" }>) => void;
  let provideStart: (start: FileStart | ReadFailure | null) => void = () => undefined;
  const module = new Promise<WebAssembly.Module>((resolve, reject) => {
    provideModule = (message) => ("module" in message ? resolve(message.module) : reject(new Error(message.problem)));
  });
  module.catch(() => undefined); // the host reports it when a source is opened
  const host = new PlayerHost(module, startDecoder, (message, transfer) => scope.postMessage(message, transfer));
  scope.onmessage = ({ data }) => {
    if (data.type === "core") provideModule(data);
    else if (data.type === "expect") host.expect(data.source, new Promise((resolve) => (provideStart = resolve)));
    else if (data.type === "start") provideStart(data.start);
    else host.handle(data);
  };
}

const scope: unknown = self;
if ((scope as { name: string }).name === DECODER) runDecoder(scope as Scope<DecoderRequest, DecoderReply>);
else runPlayer(scope as Scope<PageMessage | StartMessage, CoreMessage>);
