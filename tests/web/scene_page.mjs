// SPDX-License-Identifier: Apache-2.0
// The common part of the test pages of the renderers.

export const post = (name, body) => fetch(name, { method: "POST", body });
export const nextFrame = () => new Promise((resolve) => requestAnimationFrame(resolve));
export const delay = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

/** Returns the description of a scene that pack_scene wrote, with its packed segments. */
export async function sceneOf(scene) {
  const info = await (await fetch(`${scene}.json`)).json();
  const words = await (await fetch(`${scene}.bin`)).arrayBuffer();
  info.segments.forEach((segment, k) => {
    const end = k + 1 < info.segments.length ? info.segments[k + 1].at : words.byteLength;
    segment.words = words.slice(segment.at, end);
  });
  return info;
}

export async function segmentsOf(scene) {
  return (await sceneOf(scene)).segments;
}

export const copyOf = (segment) => ({ ...segment, words: segment.words.slice(0) });

/** The segments at a later time of the timeline. */
export function shifted(segments, ticks) {
  return segments.map(({ begin, end, origin, ...segment }) => (
    { ...segment, begin: begin + ticks, end: end + ticks, origin: origin + ticks }));
}

/** Posts the last frame: NAME.f32, NAME.png, and the statistics as NAME.json. */
export async function postFrame(name, { canvas, renderer }) {
  const image = new Promise((resolve) => canvas.toBlob(resolve, "image/png"));
  await post(`${name}.f32`, await renderer.readPixels());
  await post(`${name}.png`, await image);
  await post(`${name}.json`, JSON.stringify(renderer.statistics));
}

/** Returns the largest difference of the canvas to readPixels() over a background, of 255. */
export async function canvasDifference({ canvas, renderer }, background) {
  const copy = document.createElement("canvas");
  copy.width = canvas.width;
  copy.height = canvas.height;
  const context = copy.getContext("2d");
  context.drawImage(canvas, 0, 0);
  const shown = context.getImageData(0, 0, copy.width, copy.height).data;
  const pixels = await renderer.readPixels();
  let largest = 0;
  for (let i = 0; i < pixels.length; ++i) {
    const behind = (1 - pixels[i - (i % 4) + 3]) * background[i % 4];
    const expected = 255 * Math.min(1, Math.max(0, pixels[i] + behind));
    largest = Math.max(largest, Math.abs(expected - shown[i]));
  }
  return largest;
}

/** Runs a test page, which ends with the post "done". */
export async function runPage(test) {
  try {
    await test(await (await fetch("job.json")).json());
    await post("done", "ok");
  } catch (error) {
    await post("done", `${error} ${error.stack}`);
  }
}
