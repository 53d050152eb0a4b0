// SPDX-License-Identifier: Apache-2.0
// Measures the WebGPU renderer, in a page or in node with Dawn. See bench_webgpu.py.
import { overdrawOf } from "renderer/overdraw";
import { sortKindOf } from "renderer/radix_sort";
import { SplatRenderer } from "renderer/splat_renderer";

const kSegment = 65536; // primitives

/** A generator of numbers in [0, 1) with a fixed seed. */
function randomNumbers(seed) {
  let state = seed;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

/** The bits of a half float of a number between 2^-14 and 65504 in size, or 0. */
function halfOf(value) {
  if (Math.abs(value) < 2 ** -14) return 0;
  const exponent = Math.floor(Math.log2(Math.abs(value)));
  const fraction = Math.floor((Math.abs(value) / 2 ** exponent - 1) * 1024);
  return (value < 0 ? 0x8000 : 0) | ((exponent + 15) << 10) | fraction;
}

/**
 * A segment of random primitives that move, as packed_segment.h states: in a ball of radius 2 at a
 * distance of 5, all of them active, with standard deviations of `size` scene units.
 */
function randomSegment(id, primitives, shDegree, size, next) {
  const planes = Math.ceil((3 * (shDegree + 1) ** 2) / 4);
  const n = Math.ceil(primitives / 256) * 256;
  const words = new ArrayBuffer(n * (72 + 8 * planes));
  const floats = new Float32Array(words);
  const halves = new Uint16Array(words);
  const signed = () => 2 * next() - 1;
  for (let i = 0; i < n; ++i) floats.set([3e38, -3e38], 2 * i);
  for (let i = 0; i < primitives; ++i) {
    const at = [0, 1, 2].map(() => signed() + signed());
    const scale = () => (size * (0.5 + next())) ** 2;
    floats.set([-1e6, 1e6], 2 * i);
    floats.set([at[0], at[1], at[2] + 5, 10 * next()], 2 * n + 4 * i);
    floats.set([1e-3 * signed(), 1e-3 * signed(), 1e-3 * signed(), 0.1 + 0.9 * next()], 6 * n + 4 * i);
    floats.set([900, 0], 10 * n + 2 * i);
    floats.set([scale(), 0, 0, scale()], 12 * n + 4 * i);
    floats.set([0, scale()], 16 * n + 2 * i);
    for (let plane = 0; plane < planes; ++plane) {
      const numbers = [0, 1, 2, 3].map(() => halfOf((plane === 0 ? 1 : 0.2) * signed()));
      halves.set(numbers, 36 * n + 4 * (plane * n + i));
    }
  }
  return { id, primitives, shDegree, begin: 0, end: 100, origin: 0, words };
}

function randomSegments({ primitives, degree, size }) {
  const next = randomNumbers(7);
  const segments = [];
  for (let first = 0; first < primitives; first += kSegment) {
    const count = Math.min(kSegment, primitives - first);
    segments.push(randomSegment(first / kSegment, count, degree, size, next));
  }
  return segments;
}

function median(values) {
  return [...values].sort((a, b) => a - b)[values.length >> 1];
}

/** Draws a frame and returns its figures. */
async function figuresOf(device, splats, camera, ticks, view) {
  const before = splats.figures;
  splats.draw(camera, ticks, view, [0, 0, 0, 1]);
  await device.queue.onSubmittedWorkDone();
  while (splats.figures === before) await new Promise((resolve) => setTimeout(resolve, 1));
  return splats.figures;
}

/**
 * Returns the medians of the frames with a sort, milliseconds on the GPU, and the overdraw. `device`
 * needs the feature timestamp-query.
 */
async function benchOf(device, segments, sort, { primitives, degree, width, height, frames }) {
  const splats = await SplatRenderer.create(device, "rgba8unorm", { sort });
  for (const segment of segments) splats.scene.add(segment);
  const camera = {
    rotation: [1, 0, 0, 0, 1, 0, 0, 0, 1], translation: [0, 0, 0], fx: width, fy: width,
    cx: width / 2, cy: height / 2, width, height, near: 0.1,
  };
  const texture = device.createTexture({
    size: [width, height], format: "rgba8unorm", usage: GPUTextureUsage.RENDER_ATTACHMENT,
  });
  const view = texture.createView();
  const all = [];
  const start = performance.now();
  for (let k = 0; k < frames; ++k) all.push(await figuresOf(device, splats, camera, 0.25 * k, view));
  const wall = (performance.now() - start) / frames;
  const of = (name) => median(all.map((figures) => figures[name]));
  const { fragments, blended } = await overdrawOf(device, splats, camera);
  splats.destroy();
  texture.destroy();
  return {
    sort, primitives, degree, width, height, visible: of("visible"),
    project_ms: of("projectMs"), sort_ms: of("sortMs"),
    compute_ms: median(all.map(({ projectMs, sortMs }) => projectMs + sortMs)),
    raster_ms: of("rasterMs"), wall_ms: wall,
    fragments_per_pixel: fragments, blended_per_pixel: blended,
  };
}

/** Returns the figures of all sorts that a device can run, as a table and as lines of JSON. */
async function bench(device, job) {
  const sorts = new Set(["portable", sortKindOf(device)]);
  const segments = randomSegments(job);
  const lines = ["sort         project ms  sort ms  compute ms  raster ms"];
  const results = [];
  for (const sort of sorts) {
    const result = await benchOf(device, segments, sort, job);
    const cell = (name, width) => result[`${name}_ms`].toFixed(3).padStart(width);
    lines.push(sort.padEnd(12) + cell("project", 11) + cell("sort", 9) + cell("compute", 12) +
      cell("raster", 11));
    results.push(JSON.stringify(result));
  }
  return [...lines, ...results].join("\n");
}

/** The device of an adapter with its largest limits. */
async function deviceOf(gpu) {
  const adapter = await gpu.requestAdapter({ powerPreference: "high-performance" });
  if (adapter === null) throw new Error("there is no WebGPU adapter");
  const limits = ["maxBufferSize", "maxStorageBufferBindingSize"];
  return adapter.requestDevice({
    requiredFeatures: ["timestamp-query", ...["subgroups"].filter((name) => adapter.features.has(name))],
    requiredLimits: Object.fromEntries(limits.map((name) => [name, adapter.limits[name]])),
  });
}

/** In a page: posts the result of job.json. */
async function runPage() {
  const post = (name, body) => fetch(name, { method: "POST", body });
  try {
    const job = await (await fetch("job.json")).json();
    await post("result", await bench(await deviceOf(navigator.gpu), job));
    await post("done", "ok");
  } catch (error) {
    await post("done", `${error} ${error.stack}`);
  }
}

/** In node: `node bench.mjs DAWN JOB`, where DAWN is dawn.node of npm's webgpu and JOB is JSON. */
async function runNode([dawn, job]) {
  const { createRequire } = await import("node:module");
  const { create, globals } = createRequire(import.meta.url)(dawn);
  Object.assign(globalThis, globals);
  globalThis.gpu = create([]); // Dawn fails once this object is collected
  const device = await deviceOf(globalThis.gpu);
  console.log(await bench(device, JSON.parse(job)));
  process.exit(0); // Dawn keeps node running
}

if (typeof document === "undefined") await runNode(process.argv.slice(2));
else await runPage();
