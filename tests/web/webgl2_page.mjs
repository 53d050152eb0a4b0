// SPDX-License-Identifier: Apache-2.0
// Renders the cases of job.json and posts their pixels. See test_webgl2.py.
import { createWebGl2Renderer } from "./renderer.js";
import { createWebGl2Renderer as createPartsRenderer } from "./renderer_parts.js";
import {
  canvasDifference, copyOf, delay, nextFrame, post, postFrame, runPage, sceneOf, segmentsOf,
  shifted,
} from "./scene_page.mjs";

function rendererFor(options, create = createWebGl2Renderer) {
  const canvas = document.createElement("canvas");
  document.body.append(canvas);
  const renderer = create(canvas, {
    ...options, onError: (error) => post("error", String(error)),
  });
  return { canvas, renderer };
}

async function renderBackground({ scene, cases }) {
  const background = [0.2, 0, 0.6, 1];
  const page = rendererFor({ background });
  for (const segment of await segmentsOf(scene)) page.renderer.addSegment(segment);
  await page.renderer.renderExactly(cases[2].camera, cases[2].ticks);
  await post("background.json", JSON.stringify(await canvasDifference(page, background)));
}

async function renderScene({ scene, target, cases }) {
  const page = rendererFor({ target });
  const info = await sceneOf(scene);
  page.renderer.setScene({ ...info, background: [0, 0, 0] });
  for (const segment of info.segments) page.renderer.addSegment(segment);
  for (const one of cases) {
    await page.renderer.renderExactly(one.camera, one.ticks);
    await postFrame(one.name, page);
  }
  page.renderer.destroy();
  page.canvas.remove();
}

/** Adds all segments twice, removes some and adds them again: the image is that of one copy. */
async function renderReplaced({ scene, cases }) {
  const [one] = cases;
  const page = rendererFor({});
  const segments = await segmentsOf(scene);
  for (const segment of segments) page.renderer.addSegment(copyOf(segment));
  await page.renderer.renderExactly(one.camera, one.ticks);
  for (const segment of segments.slice(1)) page.renderer.addSegment(copyOf(segment));
  for (const { id } of segments.filter((_, k) => k % 3 === 0)) page.renderer.removeSegment(id);
  await page.renderer.renderExactly(one.camera, one.ticks);
  for (const segment of segments) page.renderer.addSegment(copyOf(segment));
  await page.renderer.renderExactly(one.camera, one.ticks);
  await postFrame(`${one.name}.replaced`, page);
  // A paused caller renders once and gets the frame when its order has arrived.
  for (let k = 10; k >= 0; --k) {
    page.renderer.render({ ...one.camera, cx: one.camera.cx - 8 * k }, one.ticks - 0.4 * k);
    await nextFrame();
  }
  await delay(300);
  await nextFrame();
  await postFrame(`${one.name}.rendered`, page);
  for (const { id } of segments) page.renderer.removeSegment(id);
  await page.renderer.renderExactly(one.camera, one.ticks);
  await postFrame(`${one.name}.empty`, page);
}

/** A canvas whose context lacks these extensions. */
function canvasWithout(...extensions) {
  const canvas = document.createElement("canvas");
  const gl = canvas.getContext("webgl2", { antialias: false });
  const find = gl.getExtension.bind(gl);
  gl.getExtension = (name) => (extensions.includes(name) ? null : find(name));
  return canvas;
}

/** Returns the values of a texture in R32F, row by row from the top. */
function valuesOf(gl, texture, width, height) {
  gl.bindFramebuffer(gl.FRAMEBUFFER, gl.createFramebuffer());
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
  const pixels = new Float32Array(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, pixels);
  return Float32Array.from({ length: width * height }, (_, k) => (
    pixels[4 * ((height - 1 - Math.floor(k / width)) * width + (k % width))]));
}

/** Posts the depth of a case with sums of floats and of half floats, as NAME.depth32 and .depth16. */
async function renderDepth({ scene, cases }) {
  const { name, camera, ticks } = cases[2];
  for (const [suffix, missing] of [["depth32", ""], ["depth16", "EXT_float_blend"]]) {
    const renderer = createWebGl2Renderer(canvasWithout(missing), { depth: true });
    for (const segment of await segmentsOf(scene)) renderer.addSegment(segment);
    await renderer.renderExactly(camera, ticks);
    const gl = renderer.context, depth = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, depth);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.R32F, camera.width, camera.height);
    renderer.renderViews(null, [{ camera, x: 0, y: 0, depth }], ticks, true);
    await post(`${name}.${suffix}.f32`, await renderer.readPixels());
    await post(`${name}.${suffix}`, valuesOf(gl, depth, camera.width, camera.height));
    renderer.destroy();
  }
}

/** Draws an order in several parts. */
async function renderParts({ scene, cases }) {
  const [one] = cases;
  const page = rendererFor({}, createPartsRenderer);
  for (const segment of await segmentsOf(scene)) page.renderer.addSegment(segment);
  await page.renderer.renderExactly(one.camera, one.ticks);
  await postFrame(`${one.name}.parts`, page);
}

/** A scene at a late time of the timeline, which single precision cannot represent. */
async function renderShifted({ scene, cases }) {
  const [one] = cases;
  const page = rendererFor({});
  const shift = 5e6 + 0.3;
  for (const segment of shifted(await segmentsOf(scene), shift)) page.renderer.addSegment(segment);
  await page.renderer.renderExactly(one.camera, one.ticks + shift);
  await postFrame(`${one.name}.shifted`, page);
}

/** Loses the context, adds a segment meanwhile, and restores it. */
async function renderRestored({ scene, cases }) {
  const [one] = cases;
  const page = rendererFor({});
  const [last, ...segments] = (await segmentsOf(scene)).reverse();
  for (const segment of segments) page.renderer.addSegment(segment);
  await page.renderer.renderExactly(one.camera, one.ticks);
  const extension = page.canvas.getContext("webgl2").getExtension("WEBGL_lose_context");
  const event = (name) => new Promise((done) => page.canvas.addEventListener(name, done));
  const lost = event("webglcontextlost");
  extension.loseContext();
  await lost;
  await delay(50);
  page.renderer.addSegment(last);
  const exact = page.renderer.renderExactly(one.camera, one.ticks);
  extension.restoreContext();
  await exact;
  await postFrame(`${one.name}.restored`, page);
}

/** A canvas whose context has no memory for textures of records (records.ts). */
function canvasWithoutMemory() {
  const canvas = canvasWithout("");
  const gl = canvas.getContext("webgl2"), allocate = gl.texImage2D.bind(gl);
  gl.texImage2D = (target, level, format, width, ...others) => {
    const isOfRecords = format === gl.RGBA32UI && width === 4096;
    allocate(target, level, format, isOfRecords ? 2 ** 20 : width, ...others); // too large
  };
  return canvas;
}

/** Resolves to the message of a renderer that cannot restore its context. */
async function restoreWithoutMemory() {
  const canvas = canvasWithout(), gl = canvas.getContext("webgl2"), extension = gl.getExtension("WEBGL_lose_context");
  const lost = new Promise((done) => canvas.addEventListener("webglcontextlost", done));
  const reported = new Promise((onError) => createWebGl2Renderer(canvas, { onError }));
  extension.loseContext();
  await lost;
  await delay(50);
  gl.createFramebuffer = () => null;
  extension.restoreContext();
  return (await reported).message;
}

/** Posts the messages of calls that must fail. */
async function postErrors({ scene, cases }) {
  const messages = {};
  const canvas = document.createElement("canvas");
  const renderer = createWebGl2Renderer(canvas, {
    sorterUrl: "missing.js", onError: (error) => { messages.reported = error.message; },
  });
  const [segment] = await segmentsOf(scene);
  const keep = (key) => (error) => { messages[key] = error.message; };
  const attempt = (key, work) => {
    try {
      work();
    } catch (error) {
      keep(key)(error);
    }
  };
  attempt("segment", () => renderer.addSegment({ ...segment, words: segment.words.slice(8) }));
  for (const [key, options] of [["depth", {}], ["texture", { depth: true }]]) {
    const { context, views } = createWebGl2Renderer(document.createElement("canvas"), options);
    const view = { camera: cases[0].camera, x: 0, y: 0, depth: context.createTexture() };
    attempt(key, () => views.renderViews(null, [view], 0, true));
  }
  attempt("extension", () => createWebGl2Renderer(canvasWithout("EXT_color_buffer_float"), { depth: true }));
  await renderer.renderExactly(cases[0].camera, 0).catch(keep("worker"));
  renderer.destroy();
  const other = createWebGl2Renderer(document.createElement("canvas"));
  const exact = other.renderExactly(cases[0].camera, 0);
  other.destroy();
  await exact.catch(keep("destroyed"));
  const small = createWebGl2Renderer(canvasWithoutMemory(), {
    onError: (error) => { messages.reportedMemory = error.message; },
  });
  for (const one of await segmentsOf(scene)) small.addSegment(one);
  await small.renderExactly(cases[0].camera, cases[0].ticks).catch(keep("memory"));
  small.destroy();
  messages.restored = await restoreWithoutMemory();
  const coarse = canvasWithout("EXT_color_buffer_float", "EXT_color_buffer_half_float");
  messages.format = createWebGl2Renderer(coarse).statistics.targetFormat;
  await post("errors.json", JSON.stringify(messages));
}

runPage(async ({ scenes }) => {
  for (const scene of scenes) await renderScene(scene);
  for (const test of [renderBackground, renderReplaced, renderShifted, renderParts, renderDepth, renderRestored, postErrors]) {
    await test(scenes[0]);
  }
});
