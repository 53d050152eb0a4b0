// SPDX-License-Identifier: Apache-2.0
// Players on a fake page, in the states in which tests start.
import assert from "node:assert/strict";
import { importSource } from "./import_source.mjs";
import { FakeCanvas, FakeHost, FakeRenderer, FakeWorker, settle } from "./player_fakes.mjs";

export const { StgsPlayer } = await importSource("src/player/player.ts");
const NAMES = [
  "loadstart", "durationchange", "loadedmetadata", "loadeddata", "canplay", "play", "playing",
  "pause", "waiting", "seeking", "seeked", "timeupdate", "ratechange", "ended", "error", "progress",
  "abort", "emptied", "notice", "livechange",
];

/** A player with its parts and the names of its events. */
export function setUp({ perLoad = false } = {}) {
  const host = new FakeHost();
  const renderer = new FakeRenderer();
  const canvas = new FakeCanvas();
  const workers = [];
  const create = () => {
    workers.push(new FakeWorker(host));
    return workers[workers.length - 1];
  };
  const player = new StgsPlayer({ canvas, renderer, worker: perLoad ? create : create(), host });
  const events = [];
  for (const name of NAMES) player.addEventListener(name, () => events.push(name));
  return { host, renderer, canvas, workers, worker: workers[0], player, events };
}

/** A player whose scene is open and complete. */
export async function openScene(options) {
  const parts = setUp(options);
  const loading = parts.player.load("scene.stgs");
  const worker = parts.workers[0];
  worker.opened();
  await loading;
  worker.segment(1);
  worker.state("paused", 0);
  await parts.host.run(100);
  parts.events.length = 0;
  return { ...parts, worker };
}

export async function startPlaying(options) {
  const parts = await openScene(options);
  const started = parts.player.play();
  parts.worker.state("playing", 0);
  await started;
  await settle();
  parts.events.length = 0;
  return parts;
}

/** Asserts that a promise is rejected with an error of this name. */
export const rejectsWith = (promise, name) =>
  assert.rejects(promise, (error) => error.name === name);
