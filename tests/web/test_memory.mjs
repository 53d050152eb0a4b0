// SPDX-License-Identifier: Apache-2.0
// The memory in which a worker decodes a scene of 1.7 million primitives.
//
// usage: node test_memory.mjs CORE.wasm MAKE_WEB_SCENE
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import test from "node:test";
import { jobsOfFile, primitivesOf } from "./decode_jobs.mjs";
import { importSource } from "./import_source.mjs";

const [wasm, makeScene] = process.argv.slice(2);
const { PartDecoder } = await importSource("src/core/part_decoder.ts");
const PRIMITIVES = 1_700_000, DEGREE = 3;

test("the memory of a decoder does not grow with the scene", async (t) => {
  const folder = mkdtempSync(join(tmpdir(), "stgs-memory-"));
  t.after(() => rmSync(folder, { recursive: true }));
  const path = join(folder, "scene.stgs");
  execFileSync(makeScene, [path, String(PRIMITIVES), String(DEGREE)]);
  const file = readFileSync(path), module = await WebAssembly.compile(readFileSync(wasm));
  const { jobs, pieces } = await jobsOfFile(module, path, file);
  const decoder = await PartDecoder.open({ module, name: path, fileBytes: file.length, maxMemory: 2 ** 31, pieces });
  let primitives = 0;
  for (const job of jobs) {
    const { status, parts } = decoder.decode(job);
    primitives += primitivesOf(status, parts);
  }
  t.diagnostic(`${primitives} primitives, ${(decoder.memoryBytes / 1e6).toFixed(1)} MB`);
  assert.ok(primitives > 0.99 * PRIMITIVES, `${primitives} primitives`);
  assert.ok(decoder.memoryBytes < 20e6, `${decoder.memoryBytes} bytes`);
});
