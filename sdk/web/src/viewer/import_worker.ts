// SPDX-License-Identifier: Apache-2.0
// The worker that converts a model: an entry point of its own, bundled to stgs-import.js.
import { Instance, isOutOfMemory } from "../core/instance";
import { HostDecoding } from "./host_decoding";

/** The reply to a file: the .stgs file, or why it cannot be converted. */
export type ImportReply = { bytes: ArrayBuffer } | { problem: string };

interface Exports {
  stgs_import_allocate(fileBytes: number, nameBytes: number): number;
  stgs_import_unpack(fileBytes: number): number;
  stgs_import_open(): number;
  stgs_import_convert(): number;
  stgs_import_task(): number;
  stgs_import_data(): number;
  stgs_import_bytes(): number;
}

/** The part of DedicatedWorkerGlobalScope that is used. */
interface Scope {
  onmessage: ((event: MessageEvent<File>) => void) | null;
  postMessage(message: ImportReply, transfer: Transferable[]): void;
}

/** Models are held in memory together with the primitives. */
const MAX_BYTES = 2 ** 30;
const NO_MEMORY = "the model needs more memory than the browser gives it; use 'stgs convert'";

/** Instantiates the module, which lies next to this script. */
async function load(): Promise<Instance<Exports>> {
  const url = new URL("./stgs-import.wasm", import.meta.url);
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url.pathname}: status ${response.status}; copy stgs-import.wasm next to stgs-import.js`);
  const module = await WebAssembly.compile(await response.arrayBuffer());
  return Instance.create<Exports>(module, {});
}

async function convert(file: File): Promise<ImportReply> {
  if (file.size > MAX_BYTES) return { problem: `${file.name}: larger than 1 GiB; use 'stgs convert'` };
  const [instance, content] = await Promise.all([load(), file.arrayBuffer()]);
  const wasm = instance.exports;
  const name = new TextEncoder().encode(file.name);
  const address = wasm.stgs_import_allocate(content.byteLength, name.length + 1) >>> 0;
  if (address === 0) return { problem: `${file.name}: ${NO_MEMORY}` };
  const input = instance.bytes(address, content.byteLength + name.length + 1);
  input.set(new Uint8Array(content));
  input.set(name, content.byteLength); // a zero byte follows
  const decoding = new HostDecoding(instance);
  const steps = [() => wasm.stgs_import_unpack(content.byteLength), wasm.stgs_import_open, wasm.stgs_import_convert];
  for (const step of steps) {
    const problem = step() >>> 0;
    if (problem !== 0) return { problem: instance.text(problem) };
    for (let task = wasm.stgs_import_task(); task !== 0; task = wasm.stgs_import_task()) {
      const failure = await decoding.run(task);
      if (failure !== null) return { problem: failure };
    }
  }
  return { bytes: instance.copy(wasm.stgs_import_data(), wasm.stgs_import_bytes() >>> 0) };
}

const scope = self as unknown as Scope;
scope.onmessage = ({ data: file }) => {
  convert(file).then(
    (reply) => scope.postMessage(reply, "bytes" in reply ? [reply.bytes] : []),
    (error: unknown) => {
      const isMemory = isOutOfMemory(error);
      scope.postMessage({ problem: `${file.name}: ${isMemory ? NO_MEMORY : (error as Error).message}` }, []);
    });
};
