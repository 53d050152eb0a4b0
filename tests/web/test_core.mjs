// SPDX-License-Identifier: Apache-2.0
// The compiled core reads indexes on demand and follows recordings.
//
// usage: node test_core.mjs CORE.wasm MAKE_WEB_SCENE RECORD_FRAGMENTS
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, describe, it } from "node:test";
import { CoreRun, delay, ServedFile } from "./core_host.mjs";

const [wasm, makeScene, record] = process.argv.slice(2);
const folder = mkdtempSync(join(tmpdir(), "stgs-core-"));
after(() => rmSync(folder, { recursive: true }));

/** The bytes of a file that a program writes. */
function made(program, ...args) {
  const path = join(folder, "scene.stgs");
  execFileSync(program, [path, ...args.map(String)]);
  const bytes = readFileSync(path);
  rmSync(path);
  return bytes;
}

const FRAGMENTS = 9, FRAGMENT = 1 / 3; // seconds
const recording = made(record, FRAGMENTS, 0);
const SECONDS = 3000, FRAME = 1 / 30;
const long = made(makeScene, 40000, 1, 0.1, "", SECONDS / FRAME);

/** Runs a test with a core. */
const core = (name, run) => it(name, async () => {
  const own = new CoreRun(wasm);
  try {
    await run(own);
  } finally {
    own.close();
  }
});

/** The size of the recording up to its complete fragments. */
function recorded(fragments) {
  const ends = [];
  for (let at = recording.indexOf("FRAG"); at >= 0; at = recording.indexOf("FRAG", at + 1))
    ends.push(at + 24 + Number(recording.readBigUInt64LE(at + 8)));
  return ends[fragments - 1];
}

// At the same time, since most of them wait.
describe("the core", { concurrency: true }, () => {
  core("the index is read where playback needs it", async (own) => {
    const file = new ServedFile(long);
    const info = await own.open(file, { lookAhead: 1 });
    assert.equal(info.duration, SECONDS);
    const opening = file.reads.filter(({ time }) => time <= own.openedAt).reduce((sum, { bytes }) => sum + bytes, 0);
    const pages = (long.toString("latin1").match(/PAGE/g) ?? []).length;
    assert.ok(pages >= 16, `the index has ${pages} pages`);
    assert.ok(opening <= 2 ** 17, `opening reads ${opening} bytes`);
    for (const seconds of [2500, 10, 2990]) {
      const state = await own.seek(seconds);
      assert.ok(state.buffered.some(([a, b]) => a <= seconds && seconds <= b));
      assert.ok(state.tierPrimitives.length > 0 && state.tierPrimitives.every((primitives) => primitives > 0));
      const ticks = seconds / FRAME;
      const shown = own.all("segment").filter(({ segment }) => segment.begin <= ticks && ticks <= segment.end);
      assert.ok(shown.length > 0);
    }
    assert.deepEqual(own.all("problem"), []);
    assert.ok(file.bytesRead < long.length / 2, `reads ${file.bytesRead} of ${long.length} bytes`);
  });

  core("the index of a long recording is read where playback needs it", async (own) => {
    const fragments = 600;
    const file = new ServedFile(made(record, fragments, 0));
    const info = await own.open(file, { lookAhead: 1 });
    assert.ok(Math.abs(info.duration - fragments * FRAGMENT) < 1e-6);
    for (const seconds of [150, 3]) await own.seek(seconds);
    assert.equal(own.state.live, null);
    assert.ok(file.reads.length < 60, `makes ${file.reads.length} reads`);
    assert.ok(file.bytesRead < file.size / 2, `reads ${file.bytesRead} of ${file.size} bytes`);
  });

  core("a page of the index that could not be read is read again", async (own) => {
    const file = new ServedFile(long);
    await own.open(file, { lookAhead: 1 });
    let failures = 2;
    file.fails = ({ bytes }) => bytes >= 2 ** 16 && failures-- > 0; // the index first
    await own.seek(2000);
    assert.ok(own.all("problem").some(({ kind }) => kind === "read-failed"));
  });

  core("a recording is followed until it is closed", async (own) => {
    const file = new ServedFile(recording, recorded(3));
    const info = await own.open(file);
    assert.ok(Math.abs(info.duration - 3 * FRAGMENT) < 1e-6);
    assert.equal((await own.until(({ live }) => live !== null)).live.following, true);
    own.send({ type: "play" });
    for (let fragments = 4; fragments <= FRAGMENTS; ++fragments) {
      await delay(1000 * FRAGMENT);
      file.size = recorded(fragments) + 5; // of the next one, a few bytes
      await own.until(({ duration }) => duration > (fragments - 0.5) * FRAGMENT);
      assert.equal(own.state.live.following, true);
    }
    assert.ok(own.state.seconds > 2 * FRAGMENT, "playback follows");
    assert.ok(own.state.live.latency < 2);
    file.size = recording.length;
    await own.until(({ live, state }) => live === null && state === "ended");
    assert.ok(Math.abs(own.state.duration - FRAGMENTS * FRAGMENT) < 1e-6);
    assert.deepEqual(own.all("problem"), []); // the end of the recording is none
    assert.ok(own.all("segment").some(({ segment }) => segment.end > (FRAGMENTS - 1) * 10));
    const polls = file.reads.length;
    await delay(500);
    assert.equal(file.reads.length, polls, "a closed recording is not polled");
    assert.ok(file.reads.slice(3).some(({ cache }) => cache === "no-store"));
  });

  core("a recording is joined before its first fragment", async (own) => {
    const headBytes = recording.readUInt32LE(24);
    const file = new ServedFile(recording, headBytes);
    assert.ok((await own.open(file)).duration < FRAGMENT / 2);
    own.send({ type: "play" });
    await own.until(({ live }) => live !== null);
    for (let fragments = 1; fragments <= 4; ++fragments) {
      file.size = recorded(fragments);
      await delay(1000 * FRAGMENT);
    }
    await own.until(({ state, seconds, live }) => state === "playing" && seconds > 0 && live.following);
  });

  core("a recording can be sought, and followed again", async (own) => {
    const file = new ServedFile(recording, recorded(6));
    await own.open(file);
    const early = await own.seek(0.5);
    assert.deepEqual([early.seconds, early.live.following], [0.5, false]);
    file.size = recorded(7);
    await own.until(({ duration }) => duration > 6.5 * FRAGMENT);
    own.send({ type: "seek", seconds: own.state.duration, id: ++own.lastSeek });
    const edge = await own.until(({ live }) => live.following);
    assert.ok(edge.seconds > 0.5);
  });

  core("a recording is played at the latency that the page sets", async (own) => {
    const file = new ServedFile(recording, recorded(6)); // 2 s
    await own.open(file, { latency: 1.6 });
    const first = await own.until(({ live }) => live !== null);
    assert.ok(Math.abs(first.seconds - 0.4) < 0.02 && first.live.targetLatency === 1.6, JSON.stringify(first));
    own.send({ type: "latency", seconds: 1.8 });
    own.send({ type: "latency", seconds: -1 }); // invalid
    own.send({ type: "seek", seconds: first.duration, id: ++own.lastSeek });
    await own.until(({ seek, live }) => seek === own.lastSeek && live.following);
    const { live: joined } = own.all("state").find(({ seek }) => seek === own.lastSeek);
    assert.ok(joined.targetLatency === 1.8 && Math.abs(joined.latency - 1.8) < 0.1, JSON.stringify(joined));
    own.send({ type: "latency", seconds: 0 });
    const { live } = await own.until(({ live }) => live.targetLatency < 1);
    assert.ok(live.targetLatency >= FRAGMENT);
  });

  core("polls that fail are repeated, and reported once", async (own) => {
    const file = new ServedFile(recording, recorded(3));
    await own.open(file);
    await own.until(({ live }) => live !== null);
    let failures = 3;
    file.fails = ({ offset }) => offset === 0 && failures-- > 0;
    file.size = recorded(4);
    await own.until(({ duration }) => duration > 3.5 * FRAGMENT);
    assert.equal(own.all("problem").filter(({ kind }) => kind === "read-failed").length, 1);
  });

  for (const [what, change] of [
    ["another file", (file) => (file.bytes = Buffer.from(recording).fill(7, 8, 64))],
    ["a shorter file", (file) => (file.size = recorded(1))],
  ]) {
    core(`${what} in the place of a recording is an error`, async (own) => {
      const file = new ServedFile(recording, recorded(3));
      await own.open(file);
      await own.until(({ live }) => live !== null);
      change(file);
      const { code, message } = await own.message("error");
      assert.equal(code, "network");
      assert.match(message, /replaced|shorter/);
    });
  }

  core("a read of the source before that ends late does not end one of the next source", async (own) => {
    const gates = [];
    for (const file of [new ServedFile(long), new ServedFile(long)]) {
      own.messages = [];
      const gate = { held: 0 };
      gate.opened = new Promise((open) => (gate.open = open));
      const fetch = file.fetch.bind(file);
      file.fetch = async (options) => {
        if (own.openedAt > 0) ++gate.held, await gate.opened;
        return fetch(options);
      };
      gates.push(gate);
      own.openedAt = 0;
      await own.open(file, { lookAhead: 1 });
      await own.wait(() => gate.held > 0, "read");
    }
    gates[0].open(); // these reads were aborted when the next source was opened
    await delay(100);
    assert.deepEqual(own.all("problem"), []);
    gates[1].open();
    await own.until((state) => state.layers === state.layerCount);
    assert.deepEqual(own.all("problem"), []);
  });

  core("a finished file that is replaced is an error", async (own) => {
    const file = new ServedFile(long);
    await own.open(file, { lookAhead: 1 });
    await own.seek(1);
    file.version = "b";
    own.send({ type: "seek", seconds: 2000, id: ++own.lastSeek });
    assert.match((await own.message("error")).message, /was replaced; load it again/);
  });
});
