// SPDX-License-Identifier: Apache-2.0
// The sources and the lifetime of <stgs-player>, on a fake page. test_element.py tests it in Chromium.
import assert from "node:assert/strict";
import { afterEach, test } from "node:test";
import "./fake_dom.mjs";
import { importSource } from "./import_source.mjs";
import { FakeRenderer, FakeWorker, settle } from "./player_fakes.mjs";
import { rejectsWith } from "./player_setup.mjs";
import { FakeSession, fakeViews, fakeXr } from "./xr_fakes.mjs";

const { defineStgsPlayer } = await importSource("src/element/stgs_player.ts");

const host = { now: () => performance.timeOrigin + performance.now() };
const workers = [];
let fails = false;
defineStgsPlayer({
  createWorker: () => workers[workers.push(new FakeWorker(host)) - 1],
  createRenderer() {
    if (fails) throw new Error("no WebGL2");
    return Object.assign(new FakeRenderer(), { views: fakeViews() });
  },
});

const elements = [];
afterEach(() => {
  fails = false;
  for (const element of elements.splice(0)) element.destroy(); // ends timers
});

/** An element with these attributes, which is connected. */
function show(attributes) {
  const element = new (customElements.get("stgs-player"))();
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  workers.length = 0;
  element.connect();
  elements.push(element);
  return element;
}

/** An element whose scene is open and complete. */
async function showReady(attributes = {}) {
  const element = show({ src: "scene.stgs", controls: "", ...attributes });
  await complete();
  return element;
}

/** Opens the source that was loaded last. */
async function complete() {
  const worker = workers[workers.length - 1];
  worker.opened();
  worker.segment(1);
  worker.state("paused", 0);
  await settle();
}

const part = (element, name) => element.find(name);
const lastSource = () => workers[workers.length - 1].last("open").source;

test("destroy leaves an element without a source, an image or progress", async () => {
  const element = await showReady();
  const events = [];
  for (const name of ["emptied", "pause", "error"]) element.addEventListener(name, () => events.push(name));
  element.play().catch(() => undefined);
  workers[0].state("playing", 0);
  await settle();
  assert.equal(part(element, "start").hidden, true);
  element.destroy();
  await settle();
  assert.deepEqual(events, ["emptied"]);
  assert.equal(part(element, "view").children.length, 0);
  assert.equal(part(element, "root").classes.has("has-frame"), false);
  assert.deepEqual([element.paused, element.hasSource, element.readyState], [true, false, 0]);
  const { frames } = globalThis;
  await new Promise((resolve) => setTimeout(resolve, 20));
  assert.equal(globalThis.frames, frames);
  element.load("scene.stgs").catch(() => undefined);
  await complete();
  assert.equal(part(element, "start").hidden, false); // as of a new element
  assert.equal(part(element, "view").children.length, 1);
});

test("destroy while loading hides the spinner, and after a failure the message", async () => {
  const element = show({ src: "scene.stgs" });
  await settle();
  assert.equal(part(element, "spinner").hidden, false);
  element.destroy();
  await settle();
  assert.equal(part(element, "spinner").hidden, true);
  fails = true;
  await rejectsWith(element.play(), "NotSupportedError");
  await settle();
  assert.equal(part(element, "error").hidden, false);
  element.destroy();
  await settle();
  assert.deepEqual([part(element, "error").hidden, element.error], [true, null]);
});

test("an element that is connected again invites to play", async () => {
  const element = await showReady();
  element.play().catch(() => undefined);
  await settle();
  element.remove();
  await settle();
  element.connect();
  await complete();
  assert.equal(workers.length, 2);
  assert.equal(part(element, "start").hidden, false);
});

test("load without a source is refused", async () => {
  const element = show({ autoplay: "" });
  await assert.rejects(element.load(), { name: "InvalidStateError", message: /no source/ });
  assert.equal(workers.length, 0);
  assert.equal(element.paused, true);
});

test("load with an aborted signal neither plays nor changes src", async () => {
  const element = await showReady({ autoplay: "" });
  await rejectsWith(element.load("b.stgs", { signal: AbortSignal.abort() }), "AbortError");
  assert.deepEqual([element.src, element.paused, element.hasSource], ["scene.stgs", true, false]);
});

test("the attribute src replaces a file", async () => {
  const element = await showReady();
  const file = new Blob(["x"]);
  element.load(file).catch(() => undefined);
  assert.equal(element.srcObject, file);
  element.removeAttribute("src"); // the file stays
  assert.equal(lastSource(), file);
  element.setAttribute("src", "b.stgs");
  assert.deepEqual([element.srcObject, lastSource()], [null, "https://page.example/b.stgs"]);
  element.load("c.stgs").catch(() => undefined);
  assert.deepEqual([element.src, lastSource(), workers.length], ["c.stgs", "https://page.example/c.stgs", 4]);
});

test("the playback rate survives another player", async () => {
  const element = show({});
  element.playbackRate = 2;
  assert.throws(() => (element.playbackRate = 9), { name: "NotSupportedError" });
  assert.deepEqual([element.playbackRate, workers.length], [2, 0]);
  element.src = "scene.stgs";
  await complete();
  assert.equal(workers[0].last("rate").rate, 2);
  element.playbackRate = 0.5;
  element.renderer = "webgl2";
  await complete();
  assert.deepEqual([element.playbackRate, workers[1].last("rate").rate], [0.5, 0.5]);
});

test("each change of the playback rate is reported once, also without a player", async () => {
  const element = show({ controls: "" });
  const rates = [];
  element.addEventListener("ratechange", () => rates.push(element.playbackRate));
  element.playbackRate = 2;
  assert.deepEqual(rates, []); // after the call
  await settle();
  assert.equal(part(element, "speed").textContent, "2×");
  element.playbackRate = 2;
  element.src = "scene.stgs";
  await complete();
  assert.deepEqual(rates, [2]);
  element.playbackRate = 1;
  await settle();
  element.destroy();
  element.load().catch(() => undefined);
  await complete();
  element.playbackRate = 1.5;
  await settle();
  assert.deepEqual(rates, [2, 1, 1.5]);
});

for (const [name, stop] of [
  ["destroy", (element) => element.destroy()], ["another renderer", (element) => (element.renderer = "webgl2")],
]) {
  test(`${name} ends a session, and the button offers to enter`, async (context) => {
    const { requests, restore } = fakeXr();
    context.after(restore);
    const element = await showReady();
    const events = [];
    for (const event of ["enterxr", "leavexr", "emptied"]) element.addEventListener(event, () => events.push(event));
    const label = () => part(element, "xr").getAttribute("aria-label");
    const entered = element.enterXR();
    const session = new FakeSession();
    requests[0].resolve(session);
    await entered;
    await settle();
    assert.equal(label(), "Exit VR");
    stop(element);
    await settle();
    assert.deepEqual(events, ["enterxr", "leavexr", "emptied"]);
    assert.deepEqual([label(), session.ended, element.isInXR], ["Enter VR", true, false]);
  });
}

test("there is no view of the camera without a scene", async () => {
  const element = await showReady();
  assert.notEqual(element.cameraView, null);
  element.load("b.stgs").catch(() => undefined);
  assert.equal(element.cameraView, null);
  await complete();
  assert.notEqual(element.cameraView, null);
  element.removeAttribute("src");
  assert.equal(element.cameraView, null);
});

test("the focused seek slider takes the keys up and down", async () => {
  const element = await showReady();
  const press = (key) => {
    const event = Object.assign(new Event("keydown", { cancelable: true }), { key });
    part(element, "seek").dispatchEvent(event);
    return event.defaultPrevented;
  };
  assert.equal(press("ArrowUp"), true);
  assert.deepEqual([element.currentTime, element.playbackRate], [1, 1]);
  assert.equal(press("Home"), true);
  assert.equal(element.currentTime, 0);
  assert.equal(press("k"), false);
});
