// SPDX-License-Identifier: Apache-2.0
// Decodes the content of models for the import module (sdk/web/core/host_decoding.h).
import type { Instance } from "../core/instance";
import { ImageReader } from "./image_reader";

const DAMAGED = "damaged or truncated";

/**
 * Decompresses a stream into `output`. Rejects with a message for display, without the name of the content,
 * if the decompressed size differs from that of `output`; stops reading at that size.
 */
async function inflate(format: "gzip" | "deflate-raw", input: Uint8Array, output: Uint8Array): Promise<void> {
  let decoder;
  try {
    decoder = new DecompressionStream(format);
  } catch {
    throw new Error(`this browser cannot decompress ${format}; use 'stgs convert'`);
  }
  const reader = new Blob([input]).stream().pipeThrough(decoder).getReader();
  let end = 0;
  for (;;) {
    const part = await reader.read().catch(() => {
      throw new Error(DAMAGED);
    });
    if (part.done) break;
    if (part.value.length > output.length - end) {
      reader.cancel().catch(() => undefined); // it has already failed
      throw new Error(DAMAGED);
    }
    output.set(part.value, end);
    end += part.value.length;
  }
  if (end !== output.length) throw new Error(DAMAGED);
}

/** Executes the tasks of one instance of the module. */
export class HostDecoding {
  private images: Promise<ImageReader> | null = null; // created for the first image

  /** No function of `instance` may be called during a task. */
  constructor(private readonly instance: Instance<unknown>) {}

  /** Executes the task at an address. Resolves to null, or to a message for display if it failed. */
  async run(address: number): Promise<string | null> {
    const fields = new Uint32Array(this.instance.copy(address, 7 * 4));
    const [coding, label, input, inputBytes, output, outputBytes, width] = fields as unknown as number[];
    const from = this.instance.bytes(input!, inputBytes!), to = this.instance.bytes(output!, outputBytes!);
    try {
      if (coding === 0) await inflate("gzip", from, to);
      else if (coding === 1) await inflate("deflate-raw", from, to);
      else await (await (this.images ??= ImageReader.create())).read(from, width!, to);
    } catch (error) {
      return `${this.instance.text(label!)}: ${(error as Error).message}`;
    }
    return null;
  }
}
