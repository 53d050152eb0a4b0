// SPDX-License-Identifier: Apache-2.0
// Sessions of a headset that begin while the player changes.
import assert from "node:assert/strict";
import { afterEach, beforeEach, test } from "node:test";
import { settle } from "./player_fakes.mjs";
import { openScene, rejectsWith } from "./player_setup.mjs";
import { FakeSession, fakeViews, fakeXr } from "./xr_fakes.mjs";

let requests; // of sessions
let restore;

beforeEach(() => ({ requests, restore } = fakeXr()));
afterEach(() => restore());

/** A player with an open scene, whose renderer can draw views. */
async function openViews() {
  const parts = await openScene();
  parts.renderer.views = fakeViews();
  return parts;
}

test("a session begins", async () => {
  const { player } = await openViews();
  const entered = player.enterXR();
  await rejectsWith(player.enterXR(), "InvalidStateError");
  requests[0].resolve(new FakeSession());
  await entered;
  assert.equal(player.isInXR, true);
  await player.exitXR();
  assert.equal(player.isInXR, false);
});

for (const [name, call] of [
  ["load", (player) => player.load("b.stgs").catch(() => undefined)], ["unload", (player) => player.unload()],
  ["exitXR", (player) => player.exitXR()], ["destroy", (player) => player.destroy()],
]) {
  test(`${name} ends a session that has not begun`, async () => {
    const { player } = await openViews();
    const entered = player.enterXR();
    call(player);
    const session = new FakeSession();
    requests[0].resolve(session);
    await rejectsWith(entered, "AbortError");
    assert.equal(session.ended, true);
    assert.equal(player.isInXR, false);
  });
}

test("a session that is declined after load is aborted", async () => {
  const { player } = await openViews();
  const entered = player.enterXR();
  player.load("b.stgs").catch(() => undefined);
  requests[0].reject(new DOMException("declined", "NotAllowedError"));
  await rejectsWith(entered, "AbortError");
});

test("a session that is declined has the error of the browser", async () => {
  const { player } = await openViews();
  const entered = player.enterXR();
  requests[0].reject(new DOMException("declined", "NotAllowedError"));
  await rejectsWith(entered, "NotAllowedError");
});

for (const stops of ["load", "exitXR"]) {
  test(`exitXR after ${stops} waits for a requested session, and another one can begin`, async () => {
    const { player, worker } = await openViews();
    const entered = player.enterXR();
    if (stops === "load") {
      const loaded = player.load("b.stgs");
      worker.opened();
      await loaded;
    }
    let isOver = false;
    const over = player.exitXR().then(() => (isOver = true));
    await settle();
    assert.equal(isOver, false);
    await rejectsWith(player.enterXR(), "InvalidStateError");
    const session = new FakeSession();
    requests[0].resolve(session);
    await over;
    assert.equal(session.ended, true);
    await rejectsWith(entered, "AbortError");
    const next = player.enterXR();
    requests[1].resolve(new FakeSession());
    await next;
    assert.equal(player.isInXR, true);
  });
}

test("exitXR waits for a session that is ending", async () => {
  const { player } = await openViews();
  const entered = player.enterXR();
  const session = new FakeSession();
  requests[0].resolve(session);
  await entered;
  let isEnding = false;
  session.end = async () => {
    if (isEnding) throw new DOMException("it has ended", "InvalidStateError");
    isEnding = true;
    setTimeout(() => session.dispatchEvent(new Event("end")), 1);
  };
  player.exitXR();
  await player.exitXR();
  assert.equal(player.isInXR, false);
});

test("an abort ends a session before it is prepared", async () => {
  const { player, renderer } = await openViews();
  let isPrepared = false;
  renderer.views.context.makeXRCompatible = async () => void (isPrepared = true);
  const entered = player.enterXR();
  player.load("b.stgs").catch(() => undefined);
  requests[0].resolve(new FakeSession());
  await rejectsWith(entered, "AbortError");
  assert.equal(isPrepared, false);
});

test("an abort while a session is prepared is not another error", async () => {
  const { player, renderer } = await openViews();
  renderer.views.context.makeXRCompatible = async () => {
    player.unload();
    throw new DOMException("the context is lost", "InvalidStateError");
  };
  const entered = player.enterXR();
  const session = new FakeSession();
  requests[0].resolve(session);
  await rejectsWith(entered, "AbortError");
  assert.equal(session.ended, true);
});

test("a renderer that is being loaded is not ready, and one without views is not supported", async () => {
  const { player, renderer } = await openScene();
  await rejectsWith(player.enterXR(), "NotSupportedError");
  renderer.name = null;
  await rejectsWith(player.enterXR(), "InvalidStateError");
  renderer.failure = new Error("no adapter");
  await assert.rejects(player.enterXR(), { name: "NotSupportedError", message: "the renderer failed: no adapter" });
  assert.equal(await player.supportsXR(), false);
});
