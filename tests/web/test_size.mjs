// SPDX-License-Identifier: Apache-2.0
// The size of the package, as a server sends it. STGS_WEB_PACKAGE names its folder.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import test from "node:test";
import { brotliCompressSync } from "node:zlib";

const LIMIT = 250_000; // bytes

const size = (name) => brotliCompressSync(readFileSync(join(process.env.STGS_WEB_PACKAGE, name))).length;

test("the player with one renderer takes at most 250 kB", () => {
  const common = ["stgs-core.wasm", "stgs.js", "stgs-worker.js"].map(size).reduce((a, b) => a + b);
  for (const renderer of [["stgs-webgpu.js"], ["stgs-webgl2.js", "stgs-sorter.js"]]) {
    const all = common + renderer.map(size).reduce((a, b) => a + b);
    assert.ok(all <= LIMIT, `${all} bytes with ${renderer.join(" and ")}`);
  }
});
