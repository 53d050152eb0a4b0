// SPDX-License-Identifier: Apache-2.0
// Tests of depth, occluders and several views of SplatRenderer. See test_webgpu.py.
import { SplatRenderer } from "./renderer.js";
import { copyOf, post, segmentsOf } from "./scene_page.mjs";

const kFormat = "rgba8unorm";
const kBlack = [0, 0, 0, 1];

async function deviceWith(wanted) {
  const adapter = await navigator.gpu.requestAdapter();
  const requiredFeatures = wanted.filter((name) => adapter.features.has(name));
  const device = await adapter.requestDevice({ requiredFeatures });
  device.onuncapturederror = ({ error }) => post("error", error.message);
  return device;
}

async function rendererOf(device, segments, options) {
  const splats = await SplatRenderer.create(device, kFormat, options);
  for (const segment of segments) splats.scene.add(copyOf(segment));
  return splats;
}

function textureOf(device, format, { width, height }) {
  const usage = GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.COPY_SRC;
  return device.createTexture({ size: [width, height], format, usage });
}

/** Clears a texture to a colour, or a depth texture to a depth. */
function clear(device, texture, value) {
  const encoder = device.createCommandEncoder();
  const view = texture.createView();
  const colour = { view, loadOp: "clear", storeOp: "store", clearValue: value };
  const depth = { view, depthLoadOp: "clear", depthStoreOp: "store", depthClearValue: value };
  const stencil = { stencilLoadOp: "clear", stencilStoreOp: "store" };
  encoder.beginRenderPass(Array.isArray(value)
    ? { colorAttachments: [colour] }
    : {
      colorAttachments: [],
      depthStencilAttachment: texture.format.endsWith("stencil8") ? { ...depth, ...stencil } : depth,
    }).end();
  device.queue.submit([encoder.finish()]);
}

/** Reads a texture of 4 bytes per pixel, row by row from the top, as 32-bit words. */
async function wordsOf(device, texture) {
  const { width, height } = texture;
  const bytesPerRow = Math.ceil(width / 64) * 256;
  const usage = GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ;
  const copy = device.createBuffer({ size: bytesPerRow * height, usage });
  const encoder = device.createCommandEncoder();
  encoder.copyTextureToBuffer({ texture }, { buffer: copy, bytesPerRow }, [width, height]);
  device.queue.submit([encoder.finish()]);
  await copy.mapAsync(GPUMapMode.READ);
  const rows = new Uint32Array(copy.getMappedRange());
  const words = new Uint32Array(width * height);
  for (let y = 0; y < height; ++y) {
    words.set(rows.subarray((y * bytesPerRow) / 4, (y * bytesPerRow) / 4 + width), y * width);
  }
  copy.destroy();
  return words;
}

/** Posts the depths of cases with sums of whole and of half floats, as NAME.depth32 and .depth16. */
async function postDepths(segments, cases) {
  for (const [suffix, features] of [["depth32", ["float32-blendable"]], ["depth16", []]]) {
    const device = await deviceWith([...features, "subgroups"]);
    const splats = await rendererOf(device, segments, { depth: true });
    for (const { name, camera, ticks } of cases) {
      const [image, depth] = [kFormat, "r32float"].map((format) => textureOf(device, format, camera));
      splats.drawViews(
        [{ camera, to: image.createView(), depth: depth.createView() }], ticks, kBlack);
      await post(`${name}.${suffix}`, await wordsOf(device, depth));
      if (suffix === "depth32") await post(`${name}.withdepth.f32`, await splats.read());
    }
    device.destroy();
  }
}

/** The segments without the primitives beyond a plane of the world, whose opacity becomes 0. */
function nearerThan(segments, z, ticks) {
  return segments.map((segment) => {
    const copy = copyOf(segment);
    const floats = new Float32Array(copy.words);
    const n = Math.ceil(segment.primitives / 256) * 256;
    for (let i = 0; i < n; ++i) {
      const [, , z0, time] = floats.subarray(2 * n + 4 * i, 2 * n + 4 * i + 4);
      const velocity = floats[6 * n + 4 * i + 2];
      if (z0 + velocity * (ticks - segment.origin - time) > z) floats[6 * n + 4 * i + 3] = 0;
    }
    return copy;
  });
}

/** A segment that is a number of times as large. */
function enlarged(segment, factor) {
  const copy = copyOf(segment);
  const floats = new Float32Array(copy.words);
  const n = Math.ceil(segment.primitives / 256) * 256;
  const scale = (first, count, by) => {
    for (let k = first; k < first + count; ++k) floats[k] *= by;
  };
  for (let i = 0; i < n; ++i) {
    scale(2 * n + 4 * i, 3, factor); // position
    scale(6 * n + 4 * i, 3, factor); // velocity
  }
  scale(12 * n, 6 * n, factor ** 2); // covariances
  return copy;
}

/** The largest difference of two images. */
function differenceOf(a, b) {
  return a.reduce((largest, value, k) => Math.max(largest, Math.abs(value - b[k])), 0);
}

/**
 * A wall at z hides the splats behind it: the differences to the image without these splats, by the
 * format of the depth texture. The camera looks along z of the world. `plain` has all segments.
 */
async function occlusion(device, plain, segments, { camera, ticks }, z) {
  const [near, far] = [0.05, 100];
  const octaves = Math.log2(far / near);
  const usual = [far / (far - near), (-far * near) / (far - near), 0];
  const kinds = [
    [{ format: "depth32float" }, { usual, logarithmic: [0, 0, 1 / Math.log2(1 + far)], fromNear: [-Math.log2(near) / octaves, 0, 1 / octaves, 0] }],
    [{ format: "depth24plus-stencil8" }, { stencil: usual }],
    [{ format: "depth32float", isReversed: true }, { reversed: [0, near, 0] }],
  ];
  const to = textureOf(device, kFormat, camera).createView();
  plain.draw(camera, ticks, to, kBlack);
  const all = await plain.read();
  plain.setScene({ kernel: 0 });
  nearerThan(segments, z, ticks).forEach((segment) => plain.addSegment(segment));
  plain.draw(camera, ticks, to, kBlack);
  const nearer = await plain.read();
  const differences = { none: differenceOf(all, nearer) };
  for (const [options, mappings] of kinds) {
    const depth = textureOf(device, options.format, camera);
    const splats = await rendererOf(device, segments, { occluders: options });
    for (const [name, mapping] of Object.entries(mappings)) {
      const [a, b, c, d = 1] = mapping;
      clear(device, depth, a + b / z + c * Math.log2(d + z));
      const occluders = { depth: depth.createView(), mapping };
      splats.drawViews([{ camera, to, occluders }], ticks, kBlack);
      differences[name] = differenceOf(await splats.read(), nearer);
    }
    splats.destroy();
  }
  differences.planes = differenceOf(await beyondPlanes(device, segments, { camera, ticks }, z), all);
  return differences;
}

/** The image of a scene among no objects, where the planes of the projection are both near z. */
async function beyondPlanes(device, segments, { camera, ticks }, z) {
  const [near, far] = [0.99 * z, 1.01 * z];
  const depth = textureOf(device, "depth32float", camera);
  clear(device, depth, 1);
  const splats = await rendererOf(device, segments, { occluders: { format: "depth32float" } });
  const mapping = [far / (far - near), (-far * near) / (far - near), 0];
  const to = textureOf(device, kFormat, camera).createView();
  splats.drawViews([{ camera, to, occluders: { depth: depth.createView(), mapping } }], ticks, kBlack);
  const image = await splats.read();
  splats.destroy();
  return image;
}

/** How many pixels of an image blended over a colour differ from the expected ones by more than 1 of 255. */
async function overlay(device, splats, { camera, ticks }) {
  const under = [0.25, 0.5, 0.75, 1];
  const texture = textureOf(device, kFormat, camera);
  clear(device, texture, under);
  splats.drawViews([{ camera, to: texture.createView() }], ticks, null);
  const shown = new Uint8Array((await wordsOf(device, texture)).buffer);
  const image = await splats.read();
  return image.reduce((wrong, value, k) => {
    const expected = value + (1 - image[4 * Math.floor(k / 4) + 3]) * under[k % 4];
    return wrong + (Math.abs(255 * Math.min(1, expected) - shown[k]) > 1 ? 1 : 0);
  }, 0);
}

/**
 * Draws two views in one frame, to textures of their own and side by side to one, and each view alone.
 * Returns how many pixels differ.
 */
async function views(device, segments, [first, second], ticks) {
  const both = await rendererOf(device, segments, { views: 2, depth: true });
  const sizes = [first, second];
  const images = sizes.map((camera) => textureOf(device, kFormat, camera));
  const depths = sizes.map((camera) => textureOf(device, "r32float", camera));
  const single = [];
  for (let k = 0; k < 2; ++k) {
    const view = { camera: sizes[k], to: images[k].createView(), depth: depths[k].createView() };
    both.drawViews([view], ticks, kBlack); // also one view only
    single.push([await wordsOf(device, images[k]), await wordsOf(device, depths[k])]);
    clear(device, images[k], [0, 0, 0, 0]);
    clear(device, depths[k], [0, 0, 0, 0]);
  }
  both.drawViews(sizes.map((camera, k) => (
    { camera, to: images[k].createView(), depth: depths[k].createView() })), ticks, kBlack);
  const size = { width: first.width + second.width + 4, height: Math.max(first.height, second.height) };
  const wide = textureOf(device, kFormat, size);
  clear(device, wide, [1, 0, 0, 1]);
  const at = [[0, 0], [first.width + 4, 0]];
  const wrong = { own: 0, depth: 0, wide: 0, between: 0, visible: 0 };
  for (let k = 0; k < 2; ++k) {
    const [image, depth] = [await wordsOf(device, images[k]), await wordsOf(device, depths[k])];
    single[k][0].forEach((word, i) => { wrong.own += word !== image[i]; });
    single[k][1].forEach((word, i) => { wrong.depth += word !== depth[i]; });
    wrong.visible += single[k][0].some((word) => word !== 0xff000000) ? 0 : 1;
  }
  const to = wide.createView();
  both.drawViews(sizes.map((camera, k) => ({ camera, to, at: at[k] })), ticks, kBlack);
  const pixels = await wordsOf(device, wide);
  for (let k = 0; k < 2; ++k) {
    single[k][0].forEach((word, i) => {
      const x = at[k][0] + (i % sizes[k].width);
      const y = Math.floor(i / sizes[k].width);
      wrong.wide += word !== pixels[y * size.width + x];
    });
  }
  for (let y = 0; y < size.height; ++y) {
    for (let x = 0; x < 4; ++x) {
      wrong.between += pixels[y * size.width + first.width + x] !== 0xff0000ff;
    }
  }
  return wrong;
}

/** How many words of two images differ by more than `tolerance` in a channel. */
function wrongWords(a, b, tolerance) {
  const [first, second] = [a, b].map((words) => new Uint8Array(words.buffer));
  return first.filter((value, i) => Math.abs(value - second[i]) > tolerance).length;
}

/** Draws the multisampled texture `texture` of a size to one with 1 sample, and reads it. */
async function resolvedWords(device, texture, size) {
  const to = textureOf(device, kFormat, size);
  const encoder = device.createCommandEncoder();
  encoder.beginRenderPass({
    colorAttachments: [{
      view: texture.createView(), resolveTarget: to.createView(), loadOp: "load", storeOp: "store",
    }],
  }).end();
  device.queue.submit([encoder.finish()]);
  return wordsOf(device, to);
}

/**
 * Draws with one renderer to textures of linear colours, with 4 samples, and within a rectangle. Returns how
 * many bytes or pixels differ from those of the usual textures.
 */
async function outputs(device, splats, { camera, ticks }) {
  const blue = [0.1, 0.2, 0.5, 1];
  const { width, height } = camera;
  const draw = (texture, background, view = {}, output) => {
    splats.drawViews([{ camera, to: texture.createView(), ...view }], ticks, background, output);
    return texture;
  };
  const expected = await wordsOf(device, draw(textureOf(device, kFormat, camera), blue));
  const encoding = "rgba8unorm-srgb";
  const linear = splats.output(encoding, { isLinear: true });
  const replaced = draw(textureOf(device, encoding, camera), blue, {}, linear);
  const usage = GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.TEXTURE_BINDING;
  const content = device.createTexture({ size: [width, height], format: encoding, usage });
  const blended = textureOf(device, encoding, camera);
  const linearOf = (c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
  for (const texture of [content, blended]) clear(device, texture, [...blue.slice(0, 3).map(linearOf), 1]);
  draw(blended, null, { content: content.createView() }, linear);
  const several = device.createTexture({ size: [width, height], format: kFormat, usage, sampleCount: 4 });
  draw(several, blue, {}, splats.output(kFormat, { samples: 4 }));
  const part = textureOf(device, kFormat, camera);
  clear(device, part, [1, 0, 0, 1]);
  const [x, y, w, h] = [width / 4, height / 3, width / 2, height / 2].map(Math.floor);
  const inside = (i) => {
    const [column, row] = [i % width, Math.floor(i / width)];
    return column >= x && column < x + w && row >= y && row < y + h;
  };
  const within = await wordsOf(device, draw(part, blue, { within: [x, y, w, h] }));
  return {
    linear: wrongWords(await wordsOf(device, replaced), expected, 1),
    content: wrongWords(await wordsOf(device, blended), expected, 1),
    samples: wrongWords(await resolvedWords(device, several, camera), expected, 3),
    within: within.filter((word, i) => word !== (inside(i) ? expected[i] : 0xff0000ff)).length,
  };
}

async function messageOf(call) {
  try {
    await call();
    return "";
  } catch (error) {
    return error.message;
  }
}

async function errorsOf(device, splats, { camera, ticks }) {
  const to = textureOf(device, kFormat, camera).createView();
  const view = { camera, to };
  const occluders = { depth: to, mapping: [0, 0, 0] };
  return {
    creation: await messageOf(() => SplatRenderer.create(device, kFormat, { views: 5 })),
    views: await messageOf(() => splats.drawViews([view, view], ticks, kBlack)),
    depth: await messageOf(() => splats.drawViews([{ ...view, depth: to }], ticks, kBlack)),
    occluders: await messageOf(() => splats.drawViews([{ ...view, occluders }], ticks, kBlack)),
    size: await messageOf(() => splats.draw({ ...camera, width: 320.5, height: 0 }, ticks, to, kBlack)),
    samples: await messageOf(() => splats.output(kFormat, { samples: 4, depth: true })),
    content: await messageOf(() => splats.drawViews([view], ticks, null, splats.output(kFormat, { isLinear: true }))),
    limits: await limitsOf(device, splats),
  };
}

/** The limit of a renderer of one view, per two views of another one's. */
async function limitsOf(device, single) {
  const both = await SplatRenderer.create(device, kFormat, { views: 2 });
  const { maxPrimitives } = both;
  both.destroy();
  return Math.round(single.maxPrimitives / maxPrimitives) / 2;
}

/** The depths of opaque pixels, summed as half floats, of a scene that is 1e5 times as large. */
async function farDepths(segments, { camera, ticks }) {
  const device = await deviceWith([]);
  const splats = await rendererOf(device, segments.map((segment) => enlarged(segment, 1e5)), { depth: true });
  const [image, depth] = [kFormat, "r32float"].map((format) => textureOf(device, format, camera));
  const far = { ...camera, translation: camera.translation.map((t) => 1e5 * t) };
  splats.drawViews([{ camera: far, to: image.createView(), depth: depth.createView() }], ticks, kBlack);
  const depths = new Float32Array((await wordsOf(device, depth)).buffer);
  const alphas = await splats.read();
  device.destroy();
  const values = depths.filter((_, k) => alphas[4 * k + 3] > 0.5);
  return {
    pixels: values.length, least: String(Math.min(...values)), greatest: String(Math.max(...values)),
  };
}

/** Posts the results for a scene whose first case looks along z, and whose third looks elsewhere. */
export async function testViews({ scene, cases }) {
  const segments = await segmentsOf(scene);
  await postDepths(segments, [cases[0], cases[2]]);
  const device = await deviceWith(["float32-blendable", "subgroups"]);
  const [front, , inside] = cases;
  const plain = await rendererOf(device, segments, {});
  await post("views.json", JSON.stringify({
    overlay: await overlay(device, plain, front),
    outputs: await outputs(device, plain, front),
    occlusion: await occlusion(device, plain, segments, front, 4),
    views: await views(device, segments, [front.camera, inside.camera], front.ticks),
    errors: await errorsOf(device, plain, front),
    far: await farDepths(segments, front),
  }));
  device.destroy();
}
