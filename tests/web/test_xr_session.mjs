// SPDX-License-Identifier: Apache-2.0
// Sessions of a headset that begin while the player changes.
import assert from "node:assert/strict";
import { afterEach, beforeEach, test } from "node:test";
import { settle } from "./player_fakes.mjs";
import { openScene, rejectsWith } from "./player_setup.mjs";

/** A session that draws nothing. */
class FakeSession extends EventTarget {
  ended = false;
  renderState = { baseLayer: null, depthNear: 0.1 };
  requestAnimationFrame() {
    return 1;
  }
  async requestReferenceSpace() {
    return {};
  }
  updateRenderState() {}
  async end() {
    this.ended = true;
    this.dispatchEvent(new Event("end"));
  }
}

const { navigator } = globalThis;
let requests = []; // functions that begin a session, in order

beforeEach(() => {
  requests = [];
  const xr = { requestSession: () => new Promise((resolve) => requests.push(resolve)) };
  Object.defineProperty(globalThis, "navigator", { value: { xr }, configurable: true, writable: true });
  globalThis.XRWebGLLayer = class {};
});
afterEach(() => {
  Object.defineProperty(globalThis, "navigator", { value: navigator, configurable: true, writable: true });
});

/** A player with an open scene, whose renderer can draw views. */
async function openViews() {
  const parts = await openScene();
  const context = { canvas: new EventTarget(), makeXRCompatible: async () => undefined };
  parts.renderer.views = { context, renderViews: () => undefined };
  return parts;
}

test("a session begins", async () => {
  const { player } = await openViews();
  const entered = player.enterXR();
  await rejectsWith(player.enterXR(), "InvalidStateError");
  requests[0](new FakeSession());
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
    requests[0](session);
    await rejectsWith(entered, "AbortError");
    await settle();
    assert.equal(session.ended, true);
    assert.equal(player.isInXR, false);
  });
}

test("a renderer that is being loaded is not ready, and one without views is not supported", async () => {
  const { player, renderer } = await openScene();
  await rejectsWith(player.enterXR(), "NotSupportedError");
  renderer.name = null;
  await rejectsWith(player.enterXR(), "InvalidStateError");
});
