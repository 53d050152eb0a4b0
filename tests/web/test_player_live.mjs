// SPDX-License-Identifier: Apache-2.0
// The player of a recording that is being written.
import assert from "node:assert/strict";
import { test } from "node:test";
import { settle } from "./player_fakes.mjs";
import { openScene, setUp } from "./player_setup.mjs";

const LIVE = { following: true, latency: 1.2, targetLatency: 1 };
const DETACHED = { ...LIVE, following: false, latency: 6 };

/** A player of a recording of 10 s, at its live edge. */
async function openRecording() {
  const parts = await openScene();
  parts.worker.state("paused", 9, { live: LIVE });
  await settle();
  return parts;
}

test("a recording is live until it is closed, and its duration grows", async () => {
  const { player, worker, events } = await openScene();
  assert.equal(player.live, null);
  worker.state("paused", 9, { live: LIVE });
  await settle();
  assert.deepEqual(player.live, LIVE);
  assert.equal(player.currentTime, 9);
  assert.deepEqual(events.splice(0), ["livechange"]);
  worker.state("paused", 9, { live: { ...LIVE, latency: 1.4 }, duration: 10.5, buffered: [[0, 10.5]] });
  await settle();
  assert.equal(player.duration, 10.5);
  assert.equal(player.live.latency, 1.4);
  assert.deepEqual(events.splice(0), ["durationchange", "progress"]);
  worker.state("paused", 9, { duration: 10.5, buffered: [[0, 10.5]] });
  await settle();
  assert.equal(player.live, null);
  assert.deepEqual(events.splice(0), ["livechange"]);
});

test("playback at the live edge resumes instead of starting again", async () => {
  const { player, worker } = await openRecording();
  worker.state("paused", 9.96, { live: LIVE });
  const started = player.play();
  assert.equal(worker.last("seek"), undefined);
  worker.state("playing", 9.5, { live: LIVE });
  await started;
  worker.state("buffering", 10, { live: LIVE });
  assert.equal(player.ended, false);
  assert.equal(player.paused, false);
});

test("the live edge is reached by a seek to the end, at a rate of 1", async () => {
  const { player, worker, events } = await openRecording();
  player.playbackRate = 2;
  worker.state("paused", 3, { live: DETACHED, rate: 2 });
  await settle();
  events.length = 0;
  player.goLive();
  assert.equal(worker.last("seek").seconds, 10);
  assert.equal(worker.last("rate").rate, 1);
  assert.equal(player.seeking, true);
  worker.state("paused", 9, { live: LIVE });
  await settle();
  assert.equal(player.seeking, false);
  assert.equal(player.currentTime, 9);
  for (const name of ["ratechange", "seeking", "livechange", "seeked"]) assert.ok(events.includes(name), name);
});

test("faster playback that reaches the live edge continues at a rate of 1", async () => {
  const { player, worker } = await openRecording();
  player.playbackRate = 2;
  worker.state("playing", 8.9, { live: LIVE, rate: 1 }); // from before the core received the rate
  assert.equal(player.playbackRate, 2);
  worker.state("playing", 8.9, { live: DETACHED, rate: 2 });
  assert.equal(player.playbackRate, 2);
  worker.state("playing", 9, { live: LIVE, rate: 2 });
  assert.equal(player.playbackRate, 1);
  assert.equal(worker.last("rate").rate, 1);
});

test("a loop takes effect once the recording is closed", async () => {
  const { player, worker, host } = await openRecording();
  player.loop = true;
  const started = player.play();
  worker.state("playing", 9.9, { live: LIVE });
  await started;
  await host.run(400);
  assert.ok(player.currentTime > 9.9, "the time does not wrap around");
  worker.state("playing", 9.9, {});
  await host.run(400);
  assert.ok(player.currentTime < 1, "the time wraps around");
});

test("the latency is that of the source, and can be changed at any time", async () => {
  const { player, worker } = setUp();
  assert.equal(player.latency, 1);
  player.latency = 4;
  player.load("scene.stgs").catch(() => undefined);
  assert.equal(worker.last("open").options.latency, 4);
  player.latency = 5; // before the scene is open
  assert.equal(worker.last("latency"), undefined);
  worker.opened();
  assert.equal(worker.last("latency").seconds, 5);
  player.latency = 0;
  assert.equal(worker.last("latency").seconds, 0);
  const { length } = worker.posted;
  player.latency = 0;
  for (const invalid of [-1, 3601, NaN, Infinity, "soon"])
    assert.throws(() => (player.latency = invalid), { name: "IndexSizeError", message: /out of range \(expected 0 to 3600 seconds\)/ });
  assert.deepEqual([player.latency, worker.posted.length], [0, length]);
});

test("without a recording, goLive does nothing", async () => {
  const { player, worker } = await openScene();
  player.goLive();
  assert.equal(worker.last("seek"), undefined);
});
