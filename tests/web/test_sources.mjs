// SPDX-License-Identifier: Apache-2.0
// Which scenes a link to the page may name.
import assert from "node:assert/strict";
import test from "node:test";
import { importSource } from "./import_source.mjs";

const { checkedList, linkedScene, nameOf } = await importSource("src/viewer/sources.ts");

test("links lead to the same server, or elsewhere by https", () => {
  const allowed = [
    ["scenes/a.stgs", "http://127.0.0.1:8000/", "http://127.0.0.1:8000/scenes/a.stgs"],
    ["../a%20b.stgs?x=1", "http://host/site/index.html", "http://host/a%20b.stgs?x=1"],
    ["https://other.example/a.stgs", "http://host/", "https://other.example/a.stgs"],
    ["//other.example/a.stgs", "https://host/", "https://other.example/a.stgs"],
    ["https://other.example/a.stgs", "file:///site/index.html", "https://other.example/a.stgs"],
  ];
  for (const [src, page, expected] of allowed) assert.equal(linkedScene(src, page)?.href, expected, src);
});

test("other links are refused", () => {
  const refused = [
    ["a.stgs", "file:///site/index.html"], ["file:///etc/passwd", "http://host/"], ["file:///etc/passwd", "file:///a.html"],
    ["//other.example/a.stgs", "http://host/"], ["http://other.example/a.stgs", "https://host/"],
    ["http://host:81/a.stgs", "http://host/"], ["data:,x", "http://host/"], ["blob:http://host/1", "http://host/"],
    ["javascript:alert(1)", "http://host/"], ["http://[", "http://host/"], ["ftp://host/a.stgs", "http://host/"],
  ];
  for (const [src, page] of refused) assert.equal(linkedScene(src, page), null, src);
});

test("a title is the name of the file", () => {
  assert.equal(nameOf(new URL("http://host/a/%C3%BC%20b.STGS?c=d.stgs")), "ü b");
  assert.equal(nameOf(new URL("http://host/%FF.stgs")), "%FF");
  assert.equal(nameOf(new URL("http://host/")), "");
});

test("a list has names, links and numbers", () => {
  const scene = { name: "a.stgs", href: "scenes/a.stgs", bytes: 1, modified: 2 };
  assert.deepEqual(checkedList({ scenes: [scene], complete: true }).scenes, [scene]);
  for (const value of [null, 1, {}, { scenes: {} }, { scenes: [{ ...scene, name: 1 }] }, { scenes: [{ ...scene, bytes: "1" }] }])
    assert.throws(() => checkedList(value), /list of scenes is invalid/);
});
