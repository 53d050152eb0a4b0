// SPDX-License-Identifier: Apache-2.0
// A bridge between two windows: test_element.py tests it with two origins in Chromium.
import assert from "node:assert/strict";
import { getEventListeners } from "node:events";
import { test } from "node:test";
import { importSource } from "./import_source.mjs";

const { connect, expose } = await importSource("src/stgs-bridge.ts");

/** A window that gets the messages of another one. */
class FakeWindow extends EventTarget {
  parent = this;

  constructor(origin) {
    super();
    this.origin = origin;
  }
  postMessage(data, _to, ports = []) {
    const from = { origin: this.other.origin, source: this.other };
    queueMicrotask(() => this.dispatchEvent(Object.assign(new Event("message"), { data, ports, ...from })));
  }
}

const LIVE = { following: true, latency: 1, targetLatency: 1 };

class FakePlayer extends EventTarget {
  currentTime = 1;
  duration = Infinity;
  error = null;
  live = LIVE;
  wentLive = 0;
  play() {
    return Promise.reject("no decoder"); // not an Error
  }
  pause() {
    return new Promise(() => undefined); // without an answer
  }
  goLive() {
    ++this.wentLive;
  }
}

/** Connects to a player in a frame. */
async function open(signal) {
  const inner = new FakeWindow("https://inner.example"), outer = new FakeWindow("https://outer.example");
  Object.assign(inner, { parent: outer, other: outer });
  outer.other = inner;
  const player = new FakePlayer();
  globalThis.window = inner;
  const end = expose(player, [outer.origin]);
  globalThis.window = outer;
  const remote = await connect({ contentWindow: inner }, { origin: inner.origin, signal });
  return { player, remote, end };
}

test("a recording is followed, and bad numbers are refused", async () => {
  const { player, remote, end } = await open();
  assert.deepEqual(remote.state.live, LIVE);
  await remote.goLive();
  assert.equal(player.wentLive, 1);
  await remote.seek(1e9);
  for (const seconds of [1.1e9, -2e9, NaN, Infinity, "1"]) await assert.rejects(remote.seek(seconds), { name: "TypeError" });
  assert.equal(player.currentTime, 1e9);
  await assert.rejects(remote.play(), { name: "Error", message: "no decoder" });
  remote.close();
  end();
});

test("a signal ends the connection, and is released when the connection is closed", async () => {
  const aborted = new AbortController();
  const { remote, end } = await open(aborted.signal);
  aborted.abort();
  await assert.rejects(remote.pause(), { name: "InvalidStateError" });
  end();
  const { signal } = new AbortController();
  const other = await open(signal);
  assert.equal(getEventListeners(signal, "abort").length, 1);
  other.remote.close();
  assert.equal(getEventListeners(signal, "abort").length, 0);
  other.end();
});

test("the page with the player ends the connection", async () => {
  const { remote, end } = await open();
  const pending = remote.pause();
  end();
  await assert.rejects(pending, { name: "AbortError" });
  await assert.rejects(remote.pause(), { name: "InvalidStateError" });
  remote.close();
});
