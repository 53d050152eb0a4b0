// SPDX-License-Identifier: Apache-2.0
// The player ends sources in order: aborts, errors, other sources and destroy.
import assert from "node:assert/strict";
import { test } from "node:test";
import { importSource } from "./import_source.mjs";
import { INFO, settle } from "./player_fakes.mjs";
import { openScene, rejectsWith, setUp, startPlaying, StgsPlayer } from "./player_setup.mjs";

const { deviceLost } = await importSource("src/player/errors.ts");

test("an abort ends loading", async () => {
  const { player, worker, events } = setUp();
  const controller = new AbortController();
  const loading = player.load("scene.stgs", { signal: controller.signal });
  controller.abort();
  await rejectsWith(loading, "AbortError");
  worker.opened();
  await settle();
  assert.deepEqual(events, ["loadstart", "abort", "emptied"]);
  assert.equal(worker.types().pop(), "close");
  assert.equal(player.readyState, StgsPlayer.HAVE_NOTHING);
  await rejectsWith(player.load("scene.stgs", { signal: AbortSignal.abort() }), "AbortError");
});

test("an abort after loading has no effect", async () => {
  const { player, worker } = setUp();
  const controller = new AbortController();
  const loading = player.load("scene.stgs", { signal: controller.signal });
  worker.opened();
  await loading;
  controller.abort();
  assert.equal(player.duration, 10);
});

test("another load ends the first and frees its segments", async () => {
  const { player, worker, renderer, events } = await startPlaying();
  const first = player.load("b.stgs");
  await settle();
  assert.deepEqual(events, ["emptied", "loadstart"]);
  assert.equal(renderer.segments.size, 0);
  assert.equal(player.paused, true);
  worker.state("playing", 3); // of the first source
  worker.segment(9);
  assert.equal(renderer.segments.size, 0);
  const second = player.load("c.stgs");
  await rejectsWith(first, "AbortError");
  worker.opened({ ...INFO, duration: 4 });
  await second;
  assert.equal(player.duration, 4);
  assert.equal(player.currentTime, 0);
});

test("a function creates one worker per load", async () => {
  const { player, workers } = await openScene({ perLoad: true });
  const loading = player.load("b.stgs");
  assert.equal(workers.length, 2);
  assert.equal(workers[0].terminated, true);
  workers[0].opened({ ...INFO, duration: 99 });
  workers[1].opened({ ...INFO, duration: 4 });
  await loading;
  assert.equal(player.duration, 4);
  player.destroy();
  assert.equal(workers[1].terminated, true);
});

test("an error rejects the promises and is kept", async () => {
  const { player, worker, events } = setUp();
  const loading = player.load("scene.stgs");
  const started = player.play();
  worker.send({ type: "error", code: "network", message: "scene.stgs: HTTP 404" });
  await assert.rejects(loading, { name: "PlayerError", code: 2, message: "scene.stgs: HTTP 404" });
  await rejectsWith(started, "NotSupportedError");
  await settle();
  assert.equal(events.pop(), "error");
  assert.equal(player.error.reason, "network");
  await rejectsWith(player.play(), "NotSupportedError");
  const again = player.load("scene.stgs");
  assert.equal(player.error, null);
  worker.opened();
  await again;
});

test("errors have the codes of media elements", async () => {
  const { player, worker } = await openScene();
  worker.send({ type: "error", code: "format", message: "damaged" });
  assert.equal(player.error.code, 3);
  player.load("b.stgs").catch(() => undefined);
  worker.send({ type: "error", code: "format", message: "this is a PNG image" });
  assert.equal(player.error.code, 4);
});

test("a worker that fails and a renderer that throws are errors", async () => {
  const { player, worker } = setUp();
  const loading = player.load("scene.stgs");
  worker.listeners.error[0]({});
  await assert.rejects(loading, /worker failed: its script could not be loaded/);
  const other = await openScene();
  other.renderer.render = () => {
    throw new Error("context lost");
  };
  other.player.resize(10, 10);
  await other.host.run(100);
  assert.match(other.player.error.message, /rendering failed: context lost/);
});

test("problems of the core are notices", async () => {
  const { player, worker } = await openScene();
  let detail = null;
  player.addEventListener("notice", (event) => (detail = event.detail));
  worker.send({ type: "problem", kind: "read-failed", message: "segment 3 is missing" });
  await settle();
  assert.deepEqual(detail, { kind: "read-failed", message: "segment 3 is missing" });
});

test("destroy while loading rejects and dispatches nothing", async () => {
  const { player, worker, renderer, events, host } = setUp();
  const loading = player.load("scene.stgs");
  const started = player.play();
  player.destroy();
  await rejectsWith(loading, "AbortError");
  await rejectsWith(started, "AbortError");
  assert.equal(worker.terminated, true);
  assert.equal(renderer.destroyed, true);
  worker.opened();
  worker.state("playing", 1);
  worker.send({ type: "error", code: "network", message: "late" });
  await host.run(100);
  assert.deepEqual(events, []);
  assert.equal(renderer.scenes, 0);
  player.destroy();
  player.pause();
  player.currentTime = 3;
  await rejectsWith(player.load("scene.stgs"), "AbortError");
  await rejectsWith(player.play(), "AbortError");
  await rejectsWith(player.screenshot(), "AbortError");
});

test("destroy rejects a screenshot", async () => {
  const { player, renderer } = await openScene();
  renderer.renderExactly = () => new Promise(() => undefined);
  const screenshot = player.screenshot();
  player.destroy();
  await rejectsWith(screenshot, "AbortError");
});

test("a lost WebGL2 context rejects screenshots", async () => {
  const { player, renderer, canvas } = await openScene();
  let isLost = false;
  renderer.views = { context: { isContextLost: () => isLost } };
  renderer.renderExactly = () => new Promise(() => undefined);
  const screenshot = player.screenshot();
  isLost = true;
  canvas.dispatchEvent(new Event("webglcontextlost"));
  await rejectsWith(screenshot, "InvalidStateError");
  await rejectsWith(player.screenshot(), "InvalidStateError");
  isLost = false;
  renderer.renderExactly = async () => undefined;
  await player.screenshot();
  assert.equal(player.error, null);
});

test("a renderer that keeps failing is one error", async () => {
  const { player, renderer, host, events } = await openScene();
  renderer.render = () => {
    throw new Error("context lost");
  };
  for (let i = 1; i < 4; ++i) {
    player.resize(10 * i, 10);
    await host.run(100);
  }
  assert.equal(events.filter((name) => name === "error").length, 1);
  assert.equal(player.hasSource, false);
});

test("destroy during playback, a seek and an event stops everything", async () => {
  const { player, worker, host, events, renderer } = await startPlaying();
  await host.run(100);
  player.currentTime = 5;
  player.currentTime = 6;
  player.addEventListener("seeking", () => player.destroy());
  await settle();
  assert.equal(events.filter((name) => name === "seeking").length, 1);
  const frames = renderer.frames.length;
  await host.run(1000);
  assert.equal(renderer.frames.length, frames);
  assert.equal(host.frames.size + host.timers.size, 0);
  assert.equal(worker.last("seek").seconds, 5);
});

test("a failure of the renderer is an error of the player", async () => {
  const { player, renderer, events } = await startPlaying();
  events.length = 0;
  renderer.onError(new Error("the GPU device was lost"));
  await settle();
  assert.deepEqual(events, ["error"]);
  assert.equal(player.error.message, "rendering failed: the GPU device was lost");
  assert.equal(player.activeRenderer, "webgl2");
});

test("a scene that the renderer refuses is an error", async () => {
  const { player, renderer, worker, events } = setUp();
  renderer.setScene = () => { throw new Error("the GPU has no memory"); };
  const loading = player.load("scene.stgs");
  worker.opened();
  await rejectsWith(loading, "PlayerError");
  await settle();
  assert.equal(player.error.message, "rendering failed: the GPU has no memory");
  assert.deepEqual(events, ["loadstart", "error"]);
});

test("a segment that the renderer refuses is an error of memory", async () => {
  const { player, renderer, worker } = await openScene();
  renderer.addSegment = () => { throw new Error("the GPU has no memory"); };
  worker.segment(2);
  assert.equal(player.error.reason, "memory");
  assert.equal(player.error.message, "rendering failed: the GPU has no memory");
});

/** The failure of a renderer whose GPU was lost. */
const loss = () => deviceLost("the GPU device was lost");

test("after the GPU was lost, playback continues at its time with another renderer", async () => {
  const { player, renderer, workers, host, events } = await startPlaying({ perLoad: true });
  const notices = [];
  player.addEventListener("notice", ({ detail }) => notices.push(detail));
  player.playbackRate = 2;
  await host.run(1000);
  const time = player.currentTime;
  assert.ok(time > 1.5);
  const error = loss();
  renderer.onError(error);
  renderer.onError(error); // a frame that was drawn meanwhile throws the same one
  await settle();
  assert.deepEqual(notices, [{ kind: "renderer", message: "the GPU device was lost" }]);
  assert.equal(player.error, null);
  assert.equal(workers.length, 2);
  assert.equal(workers[1].last("open").source, workers[0].last("open").source);
  workers[1].opened();
  await settle();
  assert.equal(renderer.scenes, 2);
  assert.equal(workers[1].last("rate").rate, 2);
  assert.ok(Math.abs(workers[1].last("seek").seconds - time) < 1e-9);
  assert.ok(workers[1].types().includes("play"));
  workers[1].segment(1);
  workers[1].state("playing", time);
  await host.run(40);
  assert.equal(events.filter((name) => name === "playing").length, 1);
  assert.equal(player.hasLostRenderer, false);

  renderer.onError(loss());
  await settle();
  assert.equal(player.error.message, "rendering failed: the GPU device was lost");
  assert.equal(player.hasLostRenderer, true);
  player.load("scene.stgs").catch(() => undefined);
  assert.equal(player.hasLostRenderer, false);
});

test("after the GPU was lost, a recording is followed again", async () => {
  for (const following of [true, false]) {
    const { player, renderer, workers, worker } = await openScene({ perLoad: true });
    worker.state("paused", 9, { live: { following, latency: 1, targetLatency: 1 } });
    player.play().catch(() => undefined);
    renderer.onError(loss());
    workers[1].opened();
    await settle();
    assert.equal(workers[1].last("seek")?.seconds, following ? undefined : 9);
    assert.ok(workers[1].types().includes("play"));
  }
});

test("a GPU that is lost without an open scene is no error", async () => {
  const { player, renderer, worker } = setUp();
  renderer.onError(loss());
  const loading = player.load("scene.stgs");
  renderer.onError(loss());
  worker.opened();
  await loading;
  assert.equal(player.error, null);
  assert.equal(renderer.scenes, 1);
  renderer.onError(loss());
  await settle();
  assert.equal(player.error, null);
  assert.equal(player.readyState, 0); // the source is loaded again
  renderer.name = null; // none could be created
  renderer.onError(new Error("no adapter"));
  assert.equal(player.hasLostRenderer, true);
});

test("without another renderer for a GPU that was lost before the scene was open, WebGL2 may draw", async () => {
  const { player, renderer, worker } = setUp();
  player.load("scene.stgs").catch(() => undefined);
  renderer.onError(loss());
  worker.opened();
  renderer.name = null;
  renderer.onError(new Error("no adapter"));
  assert.equal(player.error.message, "rendering failed: no adapter");
  assert.equal(player.hasLostRenderer, true);
});

test("another failure after a GPU was lost, and one without a loss, do not lead to WebGL2", async () => {
  const { player, renderer, workers } = await startPlaying({ perLoad: true });
  renderer.onError(loss());
  workers[1].opened();
  renderer.onError(new Error("the GPU has no memory"));
  assert.equal(player.error.message, "rendering failed: the GPU has no memory");
  assert.equal(player.hasLostRenderer, false);
  const other = setUp();
  other.renderer.name = null;
  other.player.load("scene.stgs").catch(() => undefined);
  other.renderer.onError(new Error("no adapter"));
  assert.equal(other.player.hasLostRenderer, false);
});
