// SPDX-License-Identifier: Apache-2.0
// Available in all browsers since 2023; missing from the declarations of TypeScript 4.8.

declare const DecompressionStream: {
  new(format: "gzip" | "deflate-raw"): ReadableWritablePair<Uint8Array, Uint8Array>;
};
