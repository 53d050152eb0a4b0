// SPDX-License-Identifier: Apache-2.0
// The common part of the test pages of the engines. See engine_case.py.
import { plainImage, psnr, readCanvas } from "./decode_scene.js";

export const WIDTH = 320, HEIGHT = 240, FOCAL = 280, NEAR = 0.05, FAR = 100;

/** A camera at the origin that looks along z of the scene, in the image above. */
export const CAMERA = {
  rotation: [1, 0, 0, 0, 1, 0, 0, 0, 1], translation: [0, 0, 0], fx: FOCAL, fy: FOCAL,
  cx: WIDTH / 2, cy: HEIGHT / 2, width: WIDTH, height: HEIGHT, near: NEAR,
};
/** Degrees, vertical. */
export const FOV = 2 * Math.atan(HEIGHT / 2 / FOCAL) * 180 / Math.PI;
/** The background, 0 to 255. */
export const BACKGROUND = [40, 80, 120];
/** A box on the axis: its size, and distances of its centre, before and behind all splats. */
export const BOX = { size: 0.2, color: [255, 0, 0], before: 0.4, behind: 60 };

/** The image of the engine: bytes, RGBA, from the top. Call it in the task that has rendered. */
export const imageOf = (gl) => readCanvas(gl, 0, 0, WIDTH, HEIGHT);

/** The image of a texture of a canvas: bytes, premultiplied RGBA, from the top. Call it in the task that has rendered. */
export async function textureImage(device, texture) {
  const bytesPerRow = Math.ceil(WIDTH / 64) * 256;
  const usage = GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ;
  const copy = device.createBuffer({ size: bytesPerRow * HEIGHT, usage });
  const encoder = device.createCommandEncoder();
  encoder.copyTextureToBuffer({ texture }, { buffer: copy, bytesPerRow }, [WIDTH, HEIGHT]);
  device.queue.submit([encoder.finish()]);
  await copy.mapAsync(GPUMapMode.READ);
  const bytes = new Uint8Array(copy.getMappedRange());
  const order = texture.format.startsWith("bgra") ? [2, 1, 0, 3] : [0, 1, 2, 3];
  const image = Uint8Array.from({ length: 4 * WIDTH * HEIGHT }, (_, i) => {
    const pixel = Math.floor(i / 4);
    return bytes[bytesPerRow * Math.floor(pixel / WIDTH) + 4 * (pixel % WIDTH) + order[i % 4]];
  });
  copy.destroy();
  return image;
}

/** PSNR of an image to that of the plain player, of the pixels that `uses` selects. */
export async function compare(image, camera, seconds, uses) {
  const background = [...BACKGROUND.map((value) => value / 255), 1];
  const expected = await plainImage("scene.stgs", camera, seconds, background);
  return psnr(image, expected, WIDTH, uses);
}

/** Whether a pixel is outside of the square that the box covers, with a margin of `pixels`. */
export function besideBox(distance, size, pixels) {
  const half = (FOCAL * size) / 2 / (distance - size / 2) + pixels;
  return (x, y) => Math.max(Math.abs(x + 0.5 - WIDTH / 2), Math.abs(y + 0.5 - HEIGHT / 2)) > half;
}

/** The pixel in the middle of an image. */
export function middleOf(image) {
  const at = 4 * ((HEIGHT / 2) * WIDTH + WIDTH / 2);
  return [...image.subarray(at, at + 3)];
}

/**
 * PSNR beside boxes before and behind the splats, and the colour in the middle, with and without the
 * splats. `addBox(distance, size)` returns a function that removes the box; `show(isShown)` shows or
 * hides the splats; `render()` returns the image.
 */
export async function compareBoxes({ addBox, show, render }) {
  const out = {};
  for (const place of ["before", "behind"]) {
    const size = place === "behind" ? 10 : BOX.size;
    const removeBox = addBox(BOX[place], size);
    const image = await render();
    const psnr = await compare(image, CAMERA, 1, besideBox(BOX[place], size, 2));
    show(false);
    out[place] = { psnr, middle: middleOf(image), alone: middleOf(await render()) };
    show(true);
    removeBox();
  }
  return out;
}

/** Counts the objects of a context that exist: textures, buffers, programs, vertex arrays. */
export function countObjects(gl) {
  const counts = {};
  for (const kind of ["Texture", "Buffer", "Program", "VertexArray", "Framebuffer"]) {
    counts[kind] = 0;
    for (const [verb, step] of [["create", 1], ["delete", -1]]) {
      const call = gl[verb + kind].bind(gl);
      gl[verb + kind] = (...parameters) => {
        if (verb === "create" || parameters[0] !== null) counts[kind] += step;
        return call(...parameters);
      };
    }
  }
  return counts;
}

/** Parameters of a context that drawing splats may change, and that others rely on. */
const STATE = [
  "ACTIVE_TEXTURE", "ARRAY_BUFFER_BINDING", "BLEND", "BLEND_DST_ALPHA", "BLEND_DST_RGB",
  "BLEND_EQUATION_ALPHA", "BLEND_EQUATION_RGB", "BLEND_SRC_ALPHA", "BLEND_SRC_RGB",
  "COLOR_WRITEMASK", "CULL_FACE", "CURRENT_PROGRAM", "DEPTH_FUNC", "DEPTH_TEST", "DEPTH_WRITEMASK",
  "DRAW_FRAMEBUFFER_BINDING", "ELEMENT_ARRAY_BUFFER_BINDING", "PIXEL_UNPACK_BUFFER_BINDING",
  "POLYGON_OFFSET_FILL", "RASTERIZER_DISCARD", "READ_FRAMEBUFFER_BINDING",
  "SAMPLE_ALPHA_TO_COVERAGE", "SCISSOR_BOX", "SCISSOR_TEST", "STENCIL_TEST", "UNPACK_ALIGNMENT",
  "UNPACK_FLIP_Y_WEBGL", "UNPACK_ROW_LENGTH", "VERTEX_ARRAY_BINDING", "VIEWPORT",
];
const BINDINGS = ["SAMPLER_BINDING", "TEXTURE_BINDING_2D", "TEXTURE_BINDING_2D_ARRAY"];

/** Calls `work`. Returns the names of the parameters of a context that differ afterwards. */
export function changedState(gl, work) {
  const state = () => {
    const values = STATE.map((name) => [name, gl.getParameter(gl[name])]);
    const [[, active]] = values;
    for (let unit = 0; unit < 8; ++unit) {
      gl.activeTexture(gl.TEXTURE0 + unit);
      for (const name of BINDINGS) values.push([`${name} ${unit}`, gl.getParameter(gl[name])]);
    }
    gl.activeTexture(active);
    return values;
  };
  const isSame = (a, b) => a === b || (a?.length > 0 && String(a) === String(b));
  const before = state();
  work();
  const after = state();
  return before.filter(([, value], k) => !isSame(value, after[k][1])).map(([name]) => name);
}

/** Counts the objects of a device that exist: textures, buffers, query sets. */
export function countGpuObjects(device) {
  const counts = {};
  for (const kind of ["Texture", "Buffer", "QuerySet"]) {
    counts[kind] = 0;
    const create = device["create" + kind].bind(device);
    device["create" + kind] = (descriptor) => {
      const object = create(descriptor);
      const destroy = object.destroy.bind(object);
      let exists = true;
      ++counts[kind];
      object.destroy = () => {
        if (exists) --counts[kind];
        exists = false;
        destroy();
      };
      return object;
    };
  }
  return counts;
}

export const delay = (milliseconds) => new Promise((done) => setTimeout(done, milliseconds));
