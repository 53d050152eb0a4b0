// SPDX-License-Identifier: Apache-2.0
// A renderer that is created while the player fetches. usage: node --test test_deferred_renderer.mjs
import assert from "node:assert/strict";
import { test } from "node:test";
import { importSource } from "./import_source.mjs";
import { FakeRenderer, INFO, settle } from "./player_fakes.mjs";

const { DeferredRenderer } = await importSource("src/player/deferred_renderer.ts");

const camera = INFO.startCamera;
const segment = (id) => ({ id, primitives: 1, words: new ArrayBuffer(8) });

/** A deferred renderer, and the functions that end each creation. */
function setUp() {
  const creations = [];
  const renderer = new DeferredRenderer(
    (signal) => new Promise((resolve, reject) => creations.push({ resolve, reject, signal })));
  const errors = [];
  renderer.onError = (error) => errors.push(error.message);
  return { renderer, creations, errors };
}

test("what happens before the renderer is ready happens once it is", async () => {
  const { renderer, creations } = setUp();
  renderer.setScene(INFO);
  for (const id of [1, 2, 3]) renderer.addSegment(segment(id));
  renderer.removeSegment(2);
  const moved = { ...camera, rotation: [...camera.rotation], translation: [0, 0, 1] };
  renderer.render(moved, 1);
  moved.translation[2] = 9;
  const exact = renderer.renderExactly(camera, 2);
  assert.equal(renderer.name, null);
  assert.deepEqual(renderer.statistics, { primitives: 0, visible: 0, sortMs: 0 });
  assert.equal((await renderer.readPixels()).length, 0);

  const target = new FakeRenderer();
  creations[0].resolve(target);
  await exact;
  assert.equal(target.scenes, 1);
  assert.deepEqual([...target.segments], [1, 3]);
  assert.deepEqual(target.frames.map(({ ticks, exact }) => [ticks, exact]), [[1, false], [2, true]]);
  assert.deepEqual(target.frames[0].camera.translation, [0, 0, 1]);
  assert.equal(renderer.name, "webgl2");
  assert.equal(renderer.statistics, target.statistics);

  renderer.addSegment(segment(4));
  renderer.removeSegment(1);
  renderer.render(camera, 3);
  assert.deepEqual([...target.segments], [3, 4]);
  assert.equal(target.frames.length, 3);
});

test("the segments of an earlier scene are not passed on", async () => {
  const { renderer, creations } = setUp();
  renderer.setScene(INFO);
  renderer.addSegment(segment(1));
  renderer.setScene(INFO);
  renderer.addSegment(segment(2));
  const target = new FakeRenderer();
  creations[0].resolve(target);
  await settle();
  assert.deepEqual([...target.segments], [2]);
});

test("a renderer that cannot be created is reported, and created again for the next scene", async () => {
  const { renderer, creations, errors } = setUp();
  renderer.setScene(INFO);
  const exact = renderer.renderExactly(camera, 0);
  creations[0].reject(new Error("no adapter"));
  await assert.rejects(exact, /no adapter/);
  assert.deepEqual(errors, ["no adapter"]);
  assert.throws(() => renderer.render(camera, 0), /no adapter/);
  await assert.rejects(renderer.renderExactly(camera, 0), /no adapter/);
  renderer.addSegment(segment(1)); // of the scene that ends

  renderer.setScene(INFO);
  assert.equal(creations.length, 2);
  renderer.addSegment(segment(2));
  const target = new FakeRenderer();
  creations[1].resolve(target);
  await settle();
  assert.deepEqual([...target.segments], [2]);
});

test("a renderer that fails is reported once, and replaced for the next scene", async () => {
  const { renderer, creations, errors } = setUp();
  const target = new FakeRenderer();
  creations[0].resolve(target);
  await settle();
  target.onError(new Error("lost"));
  target.onError(new Error("lost again"));
  assert.deepEqual(errors, ["lost"]);
  assert.throws(() => renderer.render(camera, 0), /lost/);
  assert.equal(target.destroyed, false);
  renderer.setScene(INFO);
  assert.equal(target.destroyed, true);
  creations[1].reject(new Error("no adapter"));
  await settle();
  assert.deepEqual(errors, ["lost", "no adapter"]);
  assert.equal(renderer.name, null);
  renderer.setScene(INFO);
  const next = new FakeRenderer();
  creations[2].resolve(next);
  await settle();
  renderer.render(camera, 0);
  assert.equal(next.frames.length, 1);
});

test("a segment that the renderer refuses is an error", async () => {
  const { renderer, creations, errors } = setUp();
  renderer.addSegment(segment(1));
  const target = new FakeRenderer();
  target.addSegment = () => { throw new Error("too large"); };
  creations[0].resolve(target);
  await settle();
  assert.deepEqual(errors, ["too large"]);
});

test("a scene that the renderer refuses is an error, and the next one has another renderer", async () => {
  const { renderer, creations, errors } = setUp();
  const target = new FakeRenderer();
  target.setScene = () => { throw new Error("out of memory"); };
  creations[0].resolve(target);
  await settle();
  assert.throws(() => renderer.setScene(INFO), /out of memory/);
  assert.deepEqual(errors, ["out of memory"]);
  renderer.setScene(INFO);
  assert.deepEqual([creations.length, target.destroyed], [2, true]);
});

test("destroy() before the renderer is ready", async () => {
  const { renderer, creations, errors } = setUp();
  const exact = renderer.renderExactly(camera, 0);
  renderer.destroy();
  await assert.rejects(exact, { name: "AbortError" });
  assert.equal(creations[0].signal.aborted, true);
  const target = new FakeRenderer();
  creations[0].resolve(target);
  await settle();
  assert.equal(target.destroyed, true);
  renderer.destroy();
  assert.deepEqual(errors, []);
});
