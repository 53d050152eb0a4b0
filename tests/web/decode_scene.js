// SPDX-License-Identifier: Apache-2.0
// Decodes scenes with the worker of the package, for tests that render them themselves.
import { createWorker } from "./stgs.js";

/**
 * Decodes a scene. Returns its description and a renderer with all segments that it needs at
 * `seconds`.
 */
export async function decode(source, canvas, seconds, target) {
  const sorterUrl = new URL("stgs-sorter.js", location.href);
  const renderer = target === "webgpu"
    ? await (await import("./stgs-webgpu.js")).createWebGpuRenderer(canvas)
    : (await import("./stgs-webgl2.js")).createWebGl2Renderer(canvas, { target, sorterUrl });
  const worker = createWorker();
  const info = await new Promise((resolve, reject) => {
    let info;
    worker.onmessage = ({ data }) => {
      if (data.type === "opened") {
        info = data.info;
        renderer.setScene(info);
        worker.postMessage({ type: "seek", seconds });
      }
      if (data.type === "segment") renderer.addSegment(data.segment);
      if (data.type === "dropped") renderer.removeSegment(data.id);
      if (data.type === "error") reject(new Error(`${data.code}: ${data.message}`));
      const isComplete = data.type === "state" && data.layers === data.layerCount;
      if (isComplete && data.seconds === seconds) resolve(info);
    };
    const options = { memoryBudget: 2 ** 29, maxPrimitives: Infinity, lookAhead: 10, latency: 1 };
    worker.postMessage({ type: "open", source, options });
  });
  worker.postMessage({ type: "close" });
  return { renderer, info };
}

/** Renders a scene by the plain renderer. Returns bytes, RGBA, from the top, over a background. */
export async function plainImage(source, camera, seconds, background, target) {
  const { renderer, info } = await decode(source, document.createElement("canvas"), seconds, target);
  await renderer.renderExactly(camera, seconds / info.tickSeconds);
  const pixels = await renderer.readPixels();
  renderer.destroy();
  return pixels.map((value, i) => {
    const behind = (1 - pixels[i - (i % 4) + 3]) * background[i % 4];
    return Math.round(255 * Math.min(1, Math.max(0, value + behind)));
  });
}

/** Reads a rectangle of the canvas of a context: bytes, RGBA, from the top. */
export function readCanvas(gl, x, y, width, height) {
  const bytes = new Uint8Array(4 * width * height);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.readPixels(x, y, width, height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
  const rows = Array.from({ length: height }, (_, k) => {
    const at = 4 * width * (height - 1 - k);
    return bytes.subarray(at, at + 4 * width);
  });
  const out = new Uint8Array(bytes.length);
  rows.forEach((row, k) => out.set(row, 4 * width * k));
  return out;
}

/** PSNR of the colours of two images, dB. `uses(x, y)`: whether a pixel counts. */
export function psnr(a, b, width, uses = () => true) {
  if (a.length !== b.length) throw new Error(`sizes differ: ${a.length} and ${b.length} bytes`);
  let square = 0, count = 0;
  for (let i = 0; i < a.length; i += 4) {
    if (!uses((i / 4) % width, Math.floor(i / 4 / width))) continue;
    for (let c = 0; c < 3; ++c) square += (a[i + c] - b[i + c]) ** 2;
    count += 3;
  }
  return square === 0 ? 200 : -10 * Math.log10(square / count / 255 ** 2);
}
