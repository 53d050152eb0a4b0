// SPDX-License-Identifier: Apache-2.0
// Models of other formats that the visitor opens.
import type { ImportReply } from "./import_worker";

/** Converts a model to an .stgs file, in a worker. Rejects with an error for display. */
export function importModel(file: File): Promise<Blob> {
  const worker = new Worker(new URL("./stgs-import.js", import.meta.url), { type: "module", name: "stgs-import" });
  const reply = new Promise<ImportReply>((resolve, reject) => {
    worker.onmessage = ({ data }: MessageEvent<ImportReply>) => resolve(data);
    worker.onerror = () => reject(new Error(`${file.name}: stgs-import.js cannot be loaded; use 'stgs convert'`));
    worker.postMessage(file);
  });
  return reply.finally(() => worker.terminate()).then((result) => {
    if ("problem" in result) throw new Error(result.problem);
    return new Blob([result.bytes]);
  });
}
