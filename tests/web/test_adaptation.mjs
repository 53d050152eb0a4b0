// SPDX-License-Identifier: Apache-2.0
// The amount fetched and drawn depends on the device and on frame times, and is reported.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { importSource } from "./import_source.mjs";
import { FakeHost, FakeRenderer, FakeWorker, INFO, settle } from "./player_fakes.mjs";
import { openScene, setUp, startPlaying } from "./player_setup.mjs";

const { deviceOf } = await importSource("src/player/device.ts");
const { FrameGovernor } = await importSource("src/player/frame_governor.ts");
const { SegmentPlayer } = await importSource("src/player/segment_player.ts");

const DESKTOP = { mobile: false, userAgent: "X11; Linux x86_64", touchPoints: 0, hasXr: true, memory: 8 };
const TIERS = { ...INFO, tierPrimitives: [600000, 1500000, 4000000] };

/** Sends frames of this rate to a governor for some seconds; returns its verdicts. */
function drive(governor, clock, framesPerSecond, seconds) {
  const verdicts = [];
  for (let i = 0; i < framesPerSecond * seconds; ++i) {
    clock.now += 1000 / framesPerSecond;
    const verdict = governor.frame(clock.now, ++clock.frames, true);
    if (verdict !== null) verdicts.push([verdict, Math.round((clock.now - clock.begin) / 1000)]);
  }
  return verdicts;
}

const isInTime = (verdicts) => verdicts.every(([verdict]) => verdict === "raise");
const clockAt = (now) => ({ begin: now, now, frames: 0 });

test("devices are recognised by the signals of the browser", () => {
  const kind = (signals) => deviceOf({ ...DESKTOP, ...signals }).kind;
  assert.equal(kind({}), "desktop");
  assert.equal(kind({ mobile: true }), "phone");
  assert.equal(kind({ mobile: null, userAgent: "iPhone; CPU iPhone OS 17_0" }), "phone");
  assert.equal(kind({ mobile: null, userAgent: "Macintosh; Intel Mac OS X", touchPoints: 5 }), "phone");
  assert.equal(kind({ mobile: null, userAgent: "Macintosh; Intel Mac OS X" }), "desktop");
  assert.equal(kind({ userAgent: "X11; Linux x86_64; Quest 3) OculusBrowser/33.0" }), "headset");
  assert.equal(kind({ userAgent: "X11; Linux x86_64; Quest 3) OculusBrowser/33.0", hasXr: false }), "desktop");
});

test("budgets depend on the device and on its memory, unless the page chooses", () => {
  const primitives = (signals, chosen) => deviceOf({ ...DESKTOP, ...signals }, chosen).maxPrimitives / 1e6;
  assert.deepEqual([2, 4, null, 8].map((memory) => primitives({ memory })), [1, 1, 3, 5]);
  assert.deepEqual([4, null, 8].map((memory) => primitives({ memory, mobile: true })), [1, 2, 3]);
  assert.equal(primitives({}, "headset"), 1);
  const { reason, memoryBudget } = deviceOf(DESKTOP, "headset");
  assert.equal(reason, "chosen by the page; 8 GiB of memory");
  assert.equal(memoryBudget, 2 ** 28);
});

test("the guide states the budgets", () => {
  const guide = readFileSync(new URL("../../sdk/docs/guide/browser.md", import.meta.url), "utf8");
  const rows = [...guide.matchAll(/^\| `(phone|headset|desktop)`.*? \| .*? \| (.*?) \| (.*?) \| (.*?) \|$/gm)];
  assert.equal(rows.length, 3);
  for (const [, kind, ...cells] of rows)
    [4, null, 8].forEach((memory, column) => {
      const { maxPrimitives, memoryBudget } = deviceOf({ ...DESKTOP, memory }, kind);
      assert.equal(cells[column], `${maxPrimitives / 1e6} million, ${memoryBudget / 2 ** 20} MiB`, `${kind}, ${memory} GiB`);
    });
});

test("the load is lowered soon and raised late", () => {
  const governor = new FrameGovernor(30), clock = clockAt(0);
  assert.deepEqual(drive(governor, clock, 20, 2.2), [["lower", 2]]);
  assert.deepEqual(drive(governor, clock, 29, 10), []); // just in time: nothing to gain
  assert.deepEqual(drive(governor, clock, 60, 10)[0][0], "raise");
});

test("each attempt that makes frames late doubles the wait for the next one", () => {
  const governor = new FrameGovernor(30), clock = clockAt(0), waits = [];
  drive(governor, clock, 10, 2.2);
  for (let k = 0; k < 4; ++k) {
    const begin = clock.now;
    while (governor.frame(clock.now += 1000 / 60, ++clock.frames, true) !== "raise");
    waits.push((clock.now - begin) / 1000);
    assert.deepEqual(drive(governor, clock, 10, 2.2).map(([verdict]) => verdict), ["lower"]);
  }
  assert.ok(waits[0] < 8 && waits.every((wait, k) => k === 0 || wait > 1.6 * waits[k - 1]), `${waits}`);
});

test("pauses and hidden pages are not late", () => {
  const governor = new FrameGovernor(30), clock = clockAt(0);
  for (let k = 0; k < 10; ++k) {
    assert.ok(isInTime(drive(governor, clock, 60, 1.5)));
    clock.now += 60_000; // hidden
    assert.ok(isInTime(drive(governor, clock, 60, 1.5)));
    governor.pause();
    clock.now += 900;
  }
  assert.ok(!isInTime(drive(governor, clock, 0.5, 20))); // frames of 2 s
});

/** Lets frames of `milliseconds` pass while a scene plays. */
async function play({ player, host, worker }, frames, milliseconds) {
  for (let i = 0; i < frames; ++i) {
    host.time += milliseconds - 20;
    if (player.currentTime > 9) worker.state("playing", (player.currentTime = 0));
    await host.run(20);
  }
}

test("late frames lower the resolution and the tiers, and still images have all pixels", async () => {
  const parts = setUp();
  const { player, worker, renderer, host } = parts;
  const reports = [];
  player.addEventListener("qualitychange", ({ detail }) => reports.push(detail));
  const loading = player.load("scene.stgs");
  worker.opened(TIERS);
  await loading;
  worker.segment(1);
  worker.state("paused", 0);
  await host.run(100);
  assert.deepEqual([reports[0].resolutionScale, reports[0].tiers, reports[0].tierCount], [1, 2, 3]);
  assert.match(reports[0].reason, /budget of a desktop is 3000000 primitives/);
  assert.equal(worker.posted[0].options.maxPrimitives, 3e6);
  player.play().catch(() => undefined);
  worker.state("playing", 0);
  await play(parts, 75, 100);
  const limits = worker.posted.filter(({ type }) => type === "maxPrimitives").map(({ primitives }) => primitives);
  assert.deepEqual(limits, [3e6, 600000]);
  const { resolutionScale, reason } = reports[reports.length - 1];
  assert.equal(resolutionScale, 0.5);
  assert.match(reason, /^10 of 30 fps: lowered the resolution$/);
  assert.deepEqual(reports.map((report) => [report.resolutionScale, report.tiers]), [[1, 2], [0.75, 2], [0.75, 1], [0.5, 1]]);
  assert.equal(renderer.frames[renderer.frames.length - 1].camera.width, 320);
  player.pause();
  worker.state("paused", 0.5);
  await host.run(100);
  const still = renderer.frames[renderer.frames.length - 1];
  assert.deepEqual([still.exact, still.camera.width, still.camera.height], [true, 640, 360]);
  assert.equal(player.stats.quality.resolutionScale, 0.5);
});

test("frames in time raise the load again", async () => {
  const parts = await startPlaying();
  await play(parts, 25, 100);
  assert.equal(parts.player.qualityReport.resolutionScale, 0.75);
  await play(parts, 500, 20);
  assert.equal(parts.player.qualityReport.resolutionScale, 1);
  assert.match(parts.player.qualityReport.reason, /^on time \(50 fps\): raised the resolution$/);
});

test("a chosen quality is fixed", async () => {
  const parts = await startPlaying();
  const { player, worker, renderer } = parts;
  player.quality = "low";
  await settle();
  assert.equal(worker.last("maxPrimitives").primitives, 1.5e6); // half of those of a desktop
  await play(parts, 75, 100);
  assert.equal(renderer.frames[renderer.frames.length - 1].camera.width, 320);
  player.quality = "high";
  assert.equal(worker.last("maxPrimitives").primitives, Infinity);
  await play(parts, 75, 100);
  assert.equal(renderer.frames[renderer.frames.length - 1].camera.width, 640);
  assert.throws(() => (player.quality = "best"), /invalid quality "best"/);
});

test("the limit of a GPU applies once the renderer is known", async () => {
  const { player, worker, renderer } = setUp();
  renderer.whenReady = Promise.resolve();
  renderer.maxPrimitives = 2e6;
  player.src = "scene.stgs";
  worker.opened(TIERS);
  await settle();
  assert.equal(worker.last("maxPrimitives").primitives, 2e6);
  assert.equal(player.qualityReport.reason, "the GPU can hold 2000000 primitives");
});

test("a choice between load and loadedmetadata reaches the core", async () => {
  const { player, worker } = setUp();
  player.src = "scene.stgs";
  player.quality = "low";
  worker.opened(TIERS);
  assert.equal(worker.last("maxPrimitives").primitives, 1.5e6);
  assert.equal(player.qualityReport.tierCount, 3);
  player.unload();
  assert.equal(player.qualityReport.tierCount, 0);
});

test("tiers adjust to new numbers of the scene", async () => {
  const parts = setUp();
  const { player, worker, host } = parts;
  player.src = "scene.stgs";
  worker.opened(TIERS);
  worker.segment(1);
  const state = (name, tierPrimitives) => worker.state(name, player.currentTime, { tierPrimitives });
  const tiers = () => [player.qualityReport.tiers, player.qualityReport.tierCount];
  state("paused", TIERS.tierPrimitives);
  assert.deepEqual(tiers(), [2, 3]);
  const { length } = worker.posted;
  state("paused", [...TIERS.tierPrimitives]);
  assert.equal(worker.posted.length, length); // nothing has changed
  state("paused", [700000, 3100000, 5000000]);
  assert.deepEqual(tiers(), [1, 3]);
  state("paused", [700000, 1600000, 2500000, 5000000]);
  assert.deepEqual(tiers(), [3, 4]);
  player.play().catch(() => undefined);
  state("playing", [700000, 1600000, 2500000, 5000000]);
  while (player.qualityReport.tiers === 3) {
    host.time += 100;
    await host.run(20);
  }
  assert.equal(worker.last("maxPrimitives").primitives, 1600000);
  state("playing", [700000, 1700000, 2500000, 5000000]); // the load stays lowered
  assert.equal(worker.last("maxPrimitives").primitives, 1700000);
  assert.deepEqual([...tiers(), player.qualityReport.resolutionScale], [2, 4, 0.75]);
  state("playing", [700000, 3200000, 4500000, 5000000]); // never above the budget
  assert.equal(worker.last("maxPrimitives").primitives, 3e6);
});

test("another size of the window does not end scaling", async () => {
  for (const resizes of [true, false]) {
    const parts = await openScene();
    const { canvas, player, worker, renderer } = parts;
    Object.assign(canvas, { clientWidth: 320, clientHeight: 180 }); // on the page
    renderer.render = (camera, ticks) => {
      renderer.frames.push({ camera, ticks, exact: false });
      Object.assign(canvas, { width: camera.width, height: camera.height });
    };
    player.play().catch(() => undefined);
    worker.state("playing", 0);
    for (let i = 0; i < 30 && canvas.width === 640; ++i) await play(parts, 1, 100);
    assert.equal(canvas.width, 480);
    Object.assign(canvas, { clientWidth: 400 });
    if (resizes) player.resize(800, 360);
    await play(parts, 2, 20);
    assert.equal(player.qualityReport.resolutionScale, 0.75);
    assert.equal(canvas.width, resizes ? 600 : 480);
  }
});

test("the limit of a renderer with which an application draws applies, too", async () => {
  const worker = new FakeWorker(new FakeHost());
  const renderer = Object.assign(new FakeRenderer(), { maxPrimitives: 2e6 });
  globalThis.requestAnimationFrame = () => 1;
  globalThis.cancelAnimationFrame = () => undefined;
  const player = new SegmentPlayer(renderer, { src: "scene.stgs", worker });
  worker.opened(TIERS);
  assert.equal(worker.last("maxPrimitives").primitives, 2e6);
  player.destroy();
});

test("the tiers of a scene that an application draws depend on its frames, its resolution does not", async (t) => {
  const host = Object.assign(new FakeHost(), { time: performance.timeOrigin });
  t.mock.method(performance, "now", () => host.time - performance.timeOrigin);
  globalThis.requestAnimationFrame = () => 1;
  globalThis.cancelAnimationFrame = () => undefined;
  const worker = new FakeWorker(host);
  const player = new SegmentPlayer(new FakeRenderer(), { src: "scene.stgs", worker, maxPrimitives: 2e6 });
  const reports = [];
  player.addEventListener("qualitychange", ({ detail }) => reports.push(detail));
  worker.opened(TIERS);
  worker.segment(1);
  player.play().catch(() => undefined);
  worker.state("playing", 0);
  /** Draws an image for each eye for some frames. */
  const draw = async (frames, milliseconds) => {
    for (let i = 0; i < frames; ++i) {
      host.time += milliseconds;
      for (let eye = 0; eye < 2; ++eye) player.frameTicks();
      await settle();
    }
  };
  await draw(60, 50); // 20 frames per second
  assert.deepEqual(reports.map(({ tiers, resolutionScale }) => [tiers, resolutionScale]), [[2, 1], [1, 1]]);
  assert.deepEqual([reports[0].reason, reports[1].reason],
    ["maxPrimitives is 2000000 primitives", "20 of 30 fps: lowered the tiers"]);
  assert.equal(worker.last("maxPrimitives").primitives, 600000);
  await draw(60, 50); // there is nothing else to lower
  assert.equal(reports.length, 2);
  player.quality = "low";
  await settle();
  assert.deepEqual([player.qualityReport.resolutionScale, reports[2].reason], [1, "quality is low"]);
  await draw(60, 50);
  assert.equal(reports.length, 3);
  player.quality = "auto";
  worker.state("paused", 0.1);
  player.pause();
  worker.state("paused", 0.1);
  await draw(60, 50); // the application draws for other reasons
  assert.equal(player.qualityReport.tiers, 2);
  player.destroy();
});

test("a canvas without a size in CSS is not scaled", async () => {
  const parts = await openScene();
  const { canvas, player, worker, renderer } = parts;
  for (const side of ["Width", "Height"]) {
    Object.defineProperty(canvas, `client${side}`, { get: () => canvas[side.toLowerCase()] });
  }
  renderer.render = (camera, ticks) => {
    renderer.frames.push({ camera, ticks, exact: false });
    Object.assign(canvas, { width: camera.width, height: camera.height });
  };
  player.play().catch(() => undefined);
  worker.state("playing", 0);
  await play(parts, 75, 100);
  const { resolutionScale, tiers } = player.qualityReport;
  assert.deepEqual([resolutionScale, tiers], [1, 1]);
  assert.deepEqual([canvas.width, canvas.height], [640, 360]);
});

test("a renderer that is late resizes the canvas late", async () => {
  const parts = await startPlaying();
  const { canvas, renderer } = parts;
  let waiting = null;
  renderer.render = (camera, ticks) => {
    if (waiting !== null) Object.assign(canvas, { width: waiting.width, height: waiting.height });
    waiting = camera;
    renderer.frames.push({ camera, ticks, exact: false });
  };
  await play(parts, 75, 100);
  assert.deepEqual([canvas.width, canvas.height], [320, 180]);
  assert.deepEqual([...new Set(renderer.frames.map(({ camera }) => camera.width))], [640, 480, 320]);
});

test("the page can give its canvas another size", async () => {
  const parts = await startPlaying();
  const { canvas, renderer } = parts;
  await play(parts, 25, 100);
  assert.equal(renderer.frames[renderer.frames.length - 1].camera.width, 480);
  Object.assign(canvas, { width: 800, height: 400 });
  await play(parts, 2, 20);
  assert.equal(renderer.frames[renderer.frames.length - 1].camera.width, 600);
});

test("the frame rate is that of completed frames", async () => {
  const { player, renderer, host } = await startPlaying();
  let frames = 0;
  renderer.statistics = { primitives: 0, visible: 0, sortMs: 0, get frames() { return Math.floor(frames); } };
  const { render } = renderer;
  renderer.render = (...view) => (frames += 0.2, render.apply(renderer, view)); // the GPU completes every fifth
  await host.run(2000);
  assert.ok(Math.abs(player.stats.framesPerSecond - 10) <= 1, `${player.stats.framesPerSecond} fps`);
  frames = 0; // of another renderer
  await host.run(100);
  assert.ok(player.stats.framesPerSecond <= 1);
  player.pause();
  await host.run(1100);
  assert.equal(player.stats.framesPerSecond, 0);
});

test("the frames of earlier renderers are not counted again", async () => {
  const { player, renderer, host } = await startPlaying();
  const own = renderer.statistics; // without a number of frames
  await host.run(2000);
  const replace = async (statistics) => {
    Object.assign(renderer, { name: null, statistics: { primitives: 0, visible: 0, sortMs: 0 } });
    await host.run(20);
    assert.ok(player.stats.framesPerSecond <= 51, `${player.stats.framesPerSecond} fps`);
    Object.assign(renderer, { name: "webgl2", statistics });
    await host.run(100);
    assert.ok(player.stats.framesPerSecond <= 51, `${player.stats.framesPerSecond} fps`);
  };
  await replace(own);
  let frames = 0;
  const { render } = renderer;
  renderer.render = (...view) => (++frames, render.apply(renderer, view));
  await replace({ ...own, get frames() { return frames; } });
  await host.run(4000);
  await replace(own);
});

test("a renderer that is being loaded draws no frames and is not late", async () => {
  const { player, renderer, host, worker } = await startPlaying();
  renderer.name = null;
  renderer.statistics = { primitives: 0, visible: 0, sortMs: 0 };
  await host.run(4000);
  worker.state("playing", 4);
  await host.run(2000);
  assert.equal(player.stats.framesPerSecond, 0);
  assert.equal(player.qualityReport.resolutionScale, 1);
});
