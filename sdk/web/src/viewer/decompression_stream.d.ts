// SPDX-License-Identifier: Apache-2.0
// In browsers since 2023; the declarations of TypeScript 4.8 do not list it.

declare const DecompressionStream: {
  new(format: "gzip" | "deflate-raw"): ReadableWritablePair<Uint8Array, Uint8Array>;
};
