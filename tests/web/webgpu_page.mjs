// SPDX-License-Identifier: Apache-2.0
// Renders the cases of job.json with WebGPU and posts their pixels. See test_webgpu.py.
import { createWebGpuRenderer, SplatRenderer } from "./renderer.js";
import {
  canvasDifference, copyOf, delay, nextFrame, post, postFrame, runPage, sceneOf, segmentsOf,
  shifted,
} from "./scene_page.mjs";
import { RadixSort, sortKindOf } from "./radix_sort.js";
import { testSort } from "./webgpu_sort.mjs";
import { testViews } from "./webgpu_views.mjs";

const devices = []; // of all renderers
const requestDevice = GPUAdapter.prototype.requestDevice;
GPUAdapter.prototype.requestDevice = async function (...options) {
  const device = await requestDevice.apply(this, options);
  devices.push(device);
  return device;
};

async function rendererFor(options = {}) {
  const canvas = document.createElement("canvas");
  document.body.append(canvas);
  const renderer = await createWebGpuRenderer(canvas, options);
  renderer.onError = (error) => post("error", String(error));
  return { canvas, renderer };
}

function close({ canvas, renderer }) {
  renderer.destroy();
  canvas.remove();
}

/** Draws a case. The figures of the frame arrive a little later. */
async function draw(page, { camera, ticks }) {
  await page.renderer.renderExactly(camera, ticks);
}

/** The cases of all scenes, one after the other. */
async function renderScenes(scenes) {
  const page = await rendererFor();
  for (const { scene, cases } of scenes) {
    const info = await sceneOf(scene);
    page.renderer.setScene({ ...info, background: [0, 0, 0] });
    for (const segment of info.segments) page.renderer.addSegment(segment);
    for (const one of cases) {
      await draw(page, one);
      await postFrame(one.name, page);
    }
  }
  close(page);
}

/** The images of two sizes in turn, and that of a canvas without a size, which is not drawn. */
async function renderResized(page, { scene, cases }) {
  for (const segment of await segmentsOf(scene)) page.renderer.addSegment(segment);
  for (const one of [cases[2], cases[0], cases[2], cases[0]]) await draw(page, one);
  await draw(page, { ...cases[2], camera: { ...cases[2].camera, width: 0 } });
  await postFrame(`${cases[0].name}.resized`, page);
}

async function renderBackground({ scene, cases }) {
  const background = [0.2, 0, 0.6, 1];
  const page = await rendererFor({ background });
  for (const segment of await segmentsOf(scene)) page.renderer.addSegment(segment);
  await draw(page, cases[2]);
  await post("background.json", JSON.stringify(await canvasDifference(page, background)));
  close(page);
}

/**
 * Segments of all scenes under other ids come and go, in an order that depends on their numbers,
 * between those of the first scene, which stay. Then everything is removed.
 */
async function renderChurn(scenes) {
  const [{ scene, cases: [one] }] = scenes;
  const page = await rendererFor();
  const others = [];
  for (const { scene: name } of scenes.slice(1)) others.push(...await segmentsOf(name));
  const kept = await segmentsOf(scene);
  others.forEach((segment, k) => { segment.id = 1000 + ((k * 7919) % others.length); });
  kept.forEach((segment) => page.renderer.addSegment(copyOf(segment)));
  for (let k = 0; k < others.length; ++k) {
    page.renderer.addSegment(copyOf(others[k]));
    if (k % 3 === 2) page.renderer.removeSegment(others[k - 2].id);
    if (k % 16 === 15) await draw(page, { ...one, ticks: k });
    if (k % 5 === 4) page.renderer.addSegment(copyOf(kept[k % kept.length]));
  }
  for (const { id } of others) page.renderer.removeSegment(id);
  await draw(page, one);
  await postFrame(`${one.name}.churn`, page);
  for (const { id } of kept) page.renderer.removeSegment(id);
  await draw(page, one);
  await postFrame(`${one.name}.empty`, page);
  close(page);
}

/** Frames without splats: behind the camera, and at a time without segments. */
async function renderNothing(page, { scene, cases: [one] }) {
  for (const segment of await segmentsOf(scene)) page.renderer.addSegment(segment);
  const far = { ...one.camera, translation: [0, 0, -1e4] };
  await draw(page, { ...one, camera: far });
  await postFrame(`${one.name}.behind`, page);
  await draw(page, { ...one, ticks: 1e6 });
  await postFrame(`${one.name}.late`, page);
}

/** A scene at a late time of the timeline, which single precision cannot represent. */
async function renderShifted(page, { scene, cases: [one] }) {
  const shift = 5e6 + 0.3;
  for (const segment of shifted(await segmentsOf(scene), shift)) page.renderer.addSegment(segment);
  await draw(page, { ...one, ticks: one.ticks + shift });
  await postFrame(`${one.name}.shifted`, page);
  await draw(page, { ticks: one.ticks + shift, camera: { ...one.camera, near: 0 } });
  await postFrame(`${one.name}.near0`, page);
}

/** What one renderer draws in turn. */
async function renderVariants(scene) {
  const page = await rendererFor();
  for (const test of [renderResized, renderNothing, renderShifted]) {
    page.renderer.setScene({ background: [0, 0, 0] });
    await test(page, scene);
  }
  close(page);
}

/** A device whose buffers are at most `bytes`. */
function smallDevice(device, bytes) {
  const limits = {
    maxBufferSize: bytes, maxStorageBufferBindingSize: bytes,
    maxTextureDimension2D: device.limits.maxTextureDimension2D,
  };
  return new Proxy(device, {
    get: (target, key) => {
      if (key === "limits") return limits;
      return typeof target[key] === "function" ? target[key].bind(target) : target[key];
    },
  });
}

const messageOf = (call) => {
  try {
    call();
    return "";
  } catch (error) {
    return error.message;
  }
};

/** Draws without a canvas, to a texture, on a device with small buffers. */
async function renderSmallBuffers({ scene, cases: [one] }) {
  const adapter = await navigator.gpu.requestAdapter();
  const device = await adapter.requestDevice();
  device.onuncapturederror = ({ error }) => post("error", error.message);
  const segments = await segmentsOf(scene);
  const largest = Math.max(...segments.map(({ words }) => words.byteLength));
  const splats = await SplatRenderer.create(smallDevice(device, largest), "rgba8unorm");
  const texture = device.createTexture({
    size: [one.camera.width, one.camera.height], format: "rgba8unorm",
    usage: GPUTextureUsage.RENDER_ATTACHMENT,
  });
  for (const segment of segments) splats.scene.add(copyOf(segment));
  splats.draw(one.camera, one.ticks, texture.createView(), [0, 0, 0, 1]);
  await post(`${one.name}.pages.f32`, await splats.read());
  const words = new ArrayBuffer(256 * 80 * 1000);
  const segment = { id: 99, primitives: 256000, shDegree: 0, begin: 0, end: 9, origin: 0, words };
  const errors = { segment: messageOf(() => splats.scene.add(segment)) };
  const others = segments.map((other) => ({ ...copyOf(other), id: other.id + 1000 }));
  for (const other of others) splats.scene.add(other);
  for (const other of others) splats.scene.add({ ...copyOf(other), id: other.id + 1000 });
  const view = texture.createView();
  errors.frame = messageOf(() => splats.draw(one.camera, one.ticks, view, [0, 0, 0, 1]));
  const { bytes } = splats.scene;
  for (const { id } of others) splats.scene.remove(id + 1000);
  for (const { id } of others) splats.scene.remove(id);
  splats.draw(one.camera, one.ticks, view, [0, 0, 0, 1]);
  await post(`${one.name}.again.f32`, await splats.read());
  await post("limits.json", JSON.stringify({ ...errors, pages: bytes / largest }));
  splats.destroy();
  device.destroy();
}

/** Posts the messages of calls that must fail, and of failures. */
async function postErrors({ scene, cases: [one] }) {
  const messages = {};
  const keep = (key) => (error) => { messages[key] = error.message; };
  const segments = await segmentsOf(scene);
  const fresh = async () => {
    const page = await rendererFor();
    for (const segment of segments) page.renderer.addSegment(copyOf(segment));
    return page;
  };
  let page = await fresh();
  messages.words = messageOf(
    () => page.renderer.addSegment({ ...segments[0], words: segments[0].words.slice(8) }));
  messages.near = messageOf(() => page.renderer.render({ ...one.camera, near: -1 }, 0));
  messages.size = messageOf(() => page.renderer.render({ ...one.camera, width: 1e6 }, 0));
  // A frame and the reading of its pixels are in flight.
  await draw(page, one);
  const pixels = page.renderer.readPixels().catch(keep("destroyed"));
  close(page);
  page.renderer.destroy();
  await pixels;
  await page.renderer.renderExactly(one.camera, 0).catch(keep("rendered"));

  page = await fresh();
  page.renderer.onError = keep("memory");
  const error = new GPUOutOfMemoryError("no memory");
  devices[devices.length - 1].dispatchEvent(
    new GPUUncapturedErrorEvent("uncapturederror", { error }));
  await page.renderer.renderExactly(one.camera, 0).catch(keep("afterMemory"));
  close(page);

  page = await fresh();
  await draw(page, one);
  const lost = new Promise((resolve) => {
    page.renderer.onError = (error) => { keep("lost")(error); resolve(); };
  });
  devices[devices.length - 1].destroy();
  await lost;
  await page.renderer.readPixels().catch(keep("afterLost"));
  messages.draw = messageOf(() => page.renderer.render(one.camera, one.ticks));
  close(page);

  const canvas = document.createElement("canvas");
  canvas.getContext("2d");
  await createWebGpuRenderer(canvas).catch(keep("canvas"));
  const controller = new AbortController();
  const count = devices.length;
  const aborted = createWebGpuRenderer(document.createElement("canvas"), { signal: controller.signal });
  while (devices.length === count) await nextFrame(); // until its shaders are being compiled
  controller.abort();
  await aborted.catch(keep("aborted"));
  await post("errors.json", JSON.stringify(messages));
}

/** Tests both sorts; the adapter must have subgroups for one of them. */
async function postSorts() {
  const adapter = await navigator.gpu.requestAdapter();
  const hasSubgroups = adapter.features.has("subgroups");
  const device = await adapter.requestDevice({ requiredFeatures: hasSubgroups ? ["subgroups"] : [] });
  device.onuncapturederror = ({ error }) => post("error", error.message);
  const chosen = sortKindOf(device);
  const results = { chosen, portable: await testSort(device, "portable") };
  if (chosen !== "portable") results[chosen] = await testSort(device, chosen);
  const plain = await (await navigator.gpu.requestAdapter()).requestDevice();
  await RadixSort.create(plain, "subgroups").catch(({ message }) => { results.refused = message; });
  plain.destroy();
  const features = new Set(["subgroups"]);
  results.varying = sortKindOf({ features, adapterInfo: { subgroupMinSize: 16, subgroupMaxSize: 32 } });
  const { subgroupMinSize, subgroupMaxSize } = device.adapterInfo ?? {};
  results.hasOneSize = hasSubgroups && subgroupMinSize === subgroupMaxSize;
  await post("sort.json", JSON.stringify(results));
  device.destroy();
}

/** Waits for the figures of a frame, which need a few frames. */
async function postStatistics({ scene, cases: [one] }) {
  const page = await rendererFor();
  for (const segment of await segmentsOf(scene)) page.renderer.addSegment(segment);
  for (let k = 0; k < 100 && page.renderer.statistics.visible === 0; ++k) {
    await draw(page, one);
    await delay(20);
    await nextFrame();
  }
  await post("statistics.json", JSON.stringify(page.renderer.statistics));
  close(page);
}

if (await navigator.gpu?.requestAdapter() == null) {
  await post("done", "no adapter");
} else {
  runPage(async ({ scenes }) => {
    await postSorts();
    await renderScenes(scenes);
    await renderChurn(scenes);
    for (const test of [renderVariants, renderBackground, renderSmallBuffers, testViews, postErrors, postStatistics]) {
      await test(scenes[0]);
    }
  });
}
