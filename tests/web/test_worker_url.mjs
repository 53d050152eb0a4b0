// SPDX-License-Identifier: Apache-2.0
// Workers are started from the page's origin, also if the package is on another one.
import assert from "node:assert/strict";
import { resolveObjectURL } from "node:buffer";
import { test } from "node:test";
import { importSource } from "./import_source.mjs";

const { workerUrl } = await importSource("src/worker_url.ts");
globalThis.self = globalThis.location = { origin: "https://page.example" };
const urlOf = (text) => workerUrl(new URL(text));

test("scripts of the page's origin, of Blobs and of data are started directly", () => {
  for (const url of ["https://page.example/stgs-worker.js", "blob:https://page.example/1", "data:text/javascript,1", "file:///a.js"])
    assert.equal(urlOf(url), url);
});

test("scripts of other origins are imported", async () => {
  for (const url of ["https://cdn.example/a/stgs-worker.js?v=1", "http://page.example/stgs-worker.js", "https://page.example:8443/x.js"]) {
    const started = urlOf(url);
    assert.equal(new URL(started).protocol, "blob:");
    const blob = resolveObjectURL(started);
    assert.equal(blob.type, "text/javascript");
    assert.equal(await blob.text(), `import "${url}";`);
  }
});

test("a sandboxed frame imports scripts of its URL's origin", () => {
  globalThis.self = { origin: "null" };
  try {
    assert.match(urlOf("https://page.example/stgs-worker.js"), /^blob:/);
  } finally {
    globalThis.self = globalThis.location;
  }
});

test("all workers of a script share a Blob", () => {
  assert.equal(urlOf("https://cdn.example/a.js"), urlOf("https://cdn.example/a.js"));
  assert.notEqual(urlOf("https://cdn.example/a.js"), urlOf("https://cdn.example/b.js"));
});
