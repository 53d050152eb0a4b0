// SPDX-License-Identifier: Apache-2.0
// The player has the semantics of a media element.
import assert from "node:assert/strict";
import { test } from "node:test";
import { INFO, settle } from "./player_fakes.mjs";
import { openScene, rejectsWith, setUp, startPlaying, StgsPlayer } from "./player_setup.mjs";

const ticksOf = (renderer) => renderer.frames.map((frame) => frame.ticks);
const near = (a, b, tolerance = 1e-6) => assert.ok(Math.abs(a - b) < tolerance, `${a} is not ${b}`);

test("loading dispatches its events in order", async () => {
  const { player, worker, events, host } = setUp();
  assert.equal(player.readyState, StgsPlayer.HAVE_NOTHING);
  assert.ok(Number.isNaN(player.duration));
  const loading = player.load("scene.stgs");
  worker.opened();
  await loading;
  assert.equal(player.readyState, StgsPlayer.HAVE_METADATA);
  assert.equal(player.duration, 10);
  worker.state("buffering", 0, { buffered: [] });
  assert.equal(player.readyState, StgsPlayer.HAVE_METADATA);
  worker.segment(1);
  worker.state("paused", 0);
  assert.equal(player.readyState, StgsPlayer.HAVE_ENOUGH_DATA);
  await host.run(20);
  assert.deepEqual(events, [
    "loadstart", "durationchange", "loadedmetadata", "progress", "progress", "loadeddata",
    "canplay",
  ]);
  assert.equal(player.buffered.length, 1);
  assert.equal(player.buffered.end(0), 10);
  assert.throws(() => player.buffered.start(1), { name: "IndexSizeError" });
});

test("the core receives the settings once the scene is open", async () => {
  const { player, worker } = setUp();
  player.playbackRate = 2;
  player.loop = true;
  player.src = "scene.stgs";
  player.currentTime = 3;
  player.play().catch(() => undefined);
  assert.deepEqual(worker.types(), ["open"]);
  worker.opened();
  assert.deepEqual(worker.types(), ["open", "maxPrimitives", "latency", "rate", "loop", "seek", "play"]);
  assert.equal(worker.posted[0].source, "scene.stgs");
  assert.ok(worker.posted[0].options.memoryBudget > 0);
  assert.equal(player.src, "scene.stgs");
});

test("play resolves when the core plays", async () => {
  const { player, worker, events } = await openScene();
  let started = false;
  const promise = player.play().then(() => (started = true));
  assert.equal(player.paused, false);
  await settle();
  assert.deepEqual(events, ["play"]);
  assert.equal(started, false);
  worker.state("playing", 0);
  await promise;
  await settle();
  assert.deepEqual(events, ["play", "playing", "timeupdate"]);
  await player.play(); // resolves at once
  player.pause();
  await settle();
  assert.deepEqual(events.slice(-2), ["timeupdate", "pause"]);
  assert.equal(worker.types().filter((type) => type === "play").length, 1);
  assert.equal(worker.types().pop(), "pause");
});

test("play before the scene is open waits for data", async () => {
  const { player, worker, events } = setUp();
  player.src = "scene.stgs";
  const started = player.play();
  worker.opened();
  worker.state("buffering", 0, { buffered: [] });
  worker.state("playing", 0);
  await started;
  await settle();
  const relevant = events.filter((name) => !["progress", "timeupdate"].includes(name));
  assert.deepEqual(relevant, [
    "loadstart", "play", "waiting", "durationchange", "loadedmetadata", "loadeddata", "canplay",
    "playing",
  ]);
});

test("pause rejects a pending play", async () => {
  const { player } = await openScene();
  const started = player.play();
  player.pause();
  await rejectsWith(started, "AbortError");
});

test("the time advances with the clock, at the rate, and never goes back", async () => {
  const { player, worker, renderer, host } = await startPlaying();
  await host.run(1000);
  near(player.currentTime, 1);
  worker.state("playing", 0.9); // the core is 0.1 s behind: the time holds
  near(player.currentTime, 1);
  await host.run(60);
  near(player.currentTime, 1);
  await host.run(140);
  near(player.currentTime, 1.1);
  player.playbackRate = 2;
  assert.deepEqual(worker.posted.pop(), { type: "rate", rate: 2 });
  worker.state("playing", 1.1, { rate: 2 });
  await host.run(500);
  near(player.currentTime, 2.1);
  const ticks = ticksOf(renderer);
  assert.ok(ticks.every((value, i) => i === 0 || value >= ticks[i - 1]));
  near(ticks[ticks.length - 1], 2.1 / 0.04);
});

test("the time is clamped to the last frame, and the end is the duration", async () => {
  const { player, worker, host, events } = await startPlaying();
  worker.state("playing", 9.9);
  await host.run(500);
  near(player.currentTime, 9.96); // the last frame
  assert.equal(player.ended, false);
  worker.state("ended", 9.96);
  await settle();
  assert.equal(player.ended, true);
  assert.equal(player.currentTime, 10);
  assert.equal(player.paused, true);
  assert.deepEqual(events.slice(-3), ["timeupdate", "pause", "ended"]);
});

test("play after the end starts from the beginning", async () => {
  const { player, worker } = await startPlaying();
  worker.state("ended", 9.96);
  const started = player.play();
  assert.equal(player.currentTime, 0);
  const [seek, play] = worker.posted.slice(-2);
  assert.deepEqual([seek.type, seek.seconds, play], ["seek", 0, { type: "play" }]);
  worker.state("ended", 9.96, { seek: 0 }); // posted before the core received the seek
  assert.equal(player.paused, false);
  worker.state("playing", 0);
  await started;
  assert.equal(player.ended, false);
  near(player.currentTime, 0);
});

test("the time follows reports that vary by part of a frame smoothly", async () => {
  const { worker, renderer, host } = await startPlaying();
  for (let i = 1; i <= 20; ++i) {
    await host.run(100);
    worker.state("playing", i / 10 - 0.03 * (i % 2));
  }
  const ticks = ticksOf(renderer).slice(-90);
  const steps = ticks.slice(1).map((value, i) => (value - ticks[i]) * 0.04);
  assert.ok(steps.every((step) => Math.abs(step - 0.02) < 0.005), `${Math.max(...steps)} s`);
});

test("play at the last frame starts from the beginning, in a loop too", async () => {
  const { player, worker } = await startPlaying();
  worker.state("ended", 9.96);
  player.loop = true;
  const started = player.play();
  worker.state("ended", 9.96); // posted before the core received the seek
  assert.equal(player.paused, false);
  worker.state("playing", 0);
  await started;
  near(player.currentTime, 0);
});

test("a clip of one frame ends although the core never plays", async () => {
  const { player, worker, host, events } = setUp();
  player.src = "scene.stgs";
  worker.opened({ ...INFO, duration: 0.04, frames: 1 });
  const one = { duration: 0.04, buffered: [[0, 0.04]] };
  worker.state("paused", 0, one);
  const started = player.play();
  worker.state("ended", 0, one);
  await host.run(1000);
  await rejectsWith(started, "AbortError");
  assert.equal(player.ended, true);
  assert.equal(events.filter((name) => name === "ended").length, 1);
});

test("a loop wraps the time without a report of the core", async () => {
  const { player, worker, renderer, host } = await startPlaying();
  player.loop = true;
  worker.state("playing", 9.8);
  await host.run(500);
  near(player.currentTime, 0.3);
  worker.state("playing", 0.25); // 0.05 s behind: holds, although a loop was in between
  near(player.currentTime, 0.3);
  worker.state("playing", 9.9); // 0.4 s behind, before the loop
  near(player.currentTime, 0.3);
  const frames = renderer.frames.length;
  await host.run(100);
  assert.ok(renderer.frames.length <= frames + 1);
});

test("a loop whose beginning is not buffered waits for the core", async () => {
  const { player, worker, host } = await startPlaying();
  player.loop = true;
  worker.state("playing", 9.8, { buffered: [[5, 10]] });
  await host.run(500);
  near(player.currentTime, 9.96);
  worker.state("buffering", 0, { buffered: [[5, 10]] });
  near(player.currentTime, 0);
});

test("buffering stops the time and dispatches waiting, then playing", async () => {
  const { player, worker, host, events } = await startPlaying();
  await host.run(500);
  worker.state("buffering", 0.5, { buffered: [[0, 0.5]] });
  await host.run(500);
  near(player.currentTime, 0.5);
  assert.equal(player.readyState, StgsPlayer.HAVE_CURRENT_DATA);
  worker.state("playing", 0.5);
  await settle();
  const relevant = events.filter((name) => !["progress", "timeupdate"].includes(name));
  assert.deepEqual(relevant, ["waiting", "canplay", "playing"]);
});

test("timeupdate is dispatched at most four times per second", async () => {
  const { worker, host, events, player } = await startPlaying();
  for (let i = 0; i < 20; ++i) {
    await host.run(100);
    worker.state("playing", player.currentTime);
  }
  const count = events.filter((name) => name === "timeupdate").length;
  assert.ok(count >= 6 && count <= 8, `${count} in 2 s`);
});

test("a seek ignores states from before it", async () => {
  const { player, worker, host, events } = await openScene();
  player.currentTime = 5;
  assert.equal(player.seeking, true);
  assert.equal(player.currentTime, 5);
  worker.state("paused", 0, { seek: 0 });
  worker.state("paused", 5.01, { seek: 0 }); // posted before the core received the seek
  assert.equal(player.seeking, true);
  worker.state("buffering", 5, { buffered: [[0, 1]] });
  assert.equal(player.seeking, true);
  worker.state("paused", 5);
  assert.equal(player.seeking, false);
  await settle();
  const relevant = events.filter((name) => name !== "progress");
  assert.deepEqual(relevant, ["seeking", "timeupdate", "seeked", "canplay"]);
  near(player.currentTime, 5);
});

test("a seek is clamped, and one before the scene is open sets the start", async () => {
  const { player, worker } = setUp();
  player.src = "scene.stgs";
  player.currentTime = 3;
  assert.equal(player.currentTime, 3);
  worker.opened();
  assert.equal(worker.last("seek").seconds, 3);
  worker.state("paused", 3);
  player.currentTime = 99;
  assert.equal(worker.last("seek").seconds, 10);
  assert.throws(() => (player.currentTime = NaN), TypeError);
});

test("a storm of seeks sends few messages and ends at the last target", async () => {
  const { player, worker, host, events } = await openScene();
  for (let i = 1; i <= 100; ++i) player.currentTime = i / 20;
  const seeks = () => worker.posted.filter((message) => message.type === "seek");
  assert.equal(seeks().length, 1);
  worker.state("paused", 0.05);
  assert.equal(player.seeking, true);
  assert.deepEqual(seeks().map((message) => message.seconds), [0.05, 5]);
  worker.state("paused", 5);
  assert.equal(player.seeking, false);
  await settle();
  assert.equal(events.filter((name) => name === "seeked").length, 1);

  player.currentTime = 7; // the core does not answer: a newer target is sent after a while
  player.currentTime = 8;
  assert.equal(worker.last("seek").seconds, 7);
  await host.run(300);
  assert.equal(worker.last("seek").seconds, 8);
});

test("a paused image whose last report is missing is shown after a while", async () => {
  const { player, worker, host } = await openScene();
  player.currentTime = 5;
  worker.state("paused", 5, { buffered: [[0, 1]] });
  await host.run(1000);
  assert.equal(player.seeking, false); // the segment of openScene() is visible at 5 s
  near(player.currentTime, 5);
  worker.send({ type: "dropped", id: 1 });
  player.currentTime = 6;
  worker.state("paused", 6, { buffered: [[0, 1]] });
  await host.run(1000);
  assert.equal(player.seeking, true);
  worker.segment(2, 140, 160);
  await host.run(300);
  worker.segment(3, 140, 160);
  await host.run(300);
  assert.equal(player.seeking, true);
  await host.run(200);
  assert.equal(player.seeking, false);
  assert.equal(host.timers.size, 0);
});

test("a seek while playing continues to play", async () => {
  const { player, worker, host } = await startPlaying();
  await host.run(200);
  player.currentTime = 6;
  await host.run(100);
  near(player.currentTime, 6);
  worker.state("playing", 6.02);
  assert.equal(player.seeking, false);
  await host.run(100);
  near(player.currentTime, 6.12);
});

test("a paused page renders once more in the exact order, then sleeps", async () => {
  const { renderer, host, worker, player } = await openScene();
  assert.deepEqual(renderer.frames.map((frame) => frame.exact), [false, true]);
  assert.equal(host.frames.size, 0);
  worker.state("paused", 0);
  worker.segment(2, 100, 200); // not visible at this time
  await host.run(100);
  assert.equal(renderer.frames.length, 2);
  worker.segment(3, 0, 10);
  await host.run(100);
  assert.equal(renderer.frames.length, 4);
  worker.send({ type: "dropped", id: 3 });
  await host.run(100);
  assert.equal(renderer.frames.length, 6);
  player.resize(320, 180);
  await host.run(100);
  assert.equal(renderer.frames.length, 8);
  assert.equal(renderer.frames[7].camera.fx, 250);
  assert.equal(host.frames.size, 0);
});

test("a camera that moves is rendered at each frame", async () => {
  const { renderer, host, player } = await openScene();
  let steps = 0;
  const camera = (width, height) => ({
    ...INFO.startCamera, width, height, translation: [steps, 0, 5],
  });
  player.cameraSource = { update: () => steps < 5 && ++steps < 5, camera };
  renderer.frames.length = 0;
  await host.run(400);
  assert.ok(renderer.frames.length >= 5);
  assert.equal(renderer.frames[renderer.frames.length - 1].exact, true);
  assert.equal(host.frames.size, 0);
});

test("a screenshot is rendered exactly", async () => {
  const { player, renderer } = await openScene();
  renderer.frames.length = 0;
  const blob = await player.screenshot();
  assert.equal(blob.type, "image/png");
  assert.deepEqual(renderer.frames.map((frame) => frame.exact), [true]);
  const other = setUp();
  other.player.src = "scene.stgs";
  other.worker.opened(); // loadedmetadata is not enough
  await assert.rejects(other.player.screenshot(), { name: "InvalidStateError", message: /loadeddata/ });
});

test("statistics report the renderer, the frames and the data", async () => {
  const { player, host } = await startPlaying();
  await host.run(2000);
  const { framesPerSecond, ...rest } = player.stats;
  assert.ok(Math.abs(framesPerSecond - 50) <= 1, `${framesPerSecond} fps`);
  assert.deepEqual(rest, {
    primitives: 1000, visible: 800, bytesFetched: 1000, bytesPerSecond: 5000, memoryBytes: 2000, sortMs: 1.5,
    layers: 2, layerCount: 3, quality: player.qualityReport,
  });
});

test("rates outside the range throw", () => {
  const { player } = setUp();
  for (const rate of [0, 5, -3, NaN]) {
    assert.throws(() => (player.playbackRate = rate), { name: "NotSupportedError" });
  }
  player.playbackRate = -1;
  assert.equal(player.playbackRate, -1);
});
