// SPDX-License-Identifier: Apache-2.0
// A player with the emulated headset of iwer; ?plain: without. See test_xr.py.
import { metaQuest3, XRDevice } from "./iwer.js";
import * as stgs from "./stgs.js";
import { decode, plainImage, psnr, readCanvas } from "./decode_scene.js";

let session = null; // the last one
if (location.search !== "?plain") {
  window.device = new XRDevice(metaQuest3);
  window.device.installRuntime({ forceInstall: true });
  const request = navigator.xr.requestSession.bind(navigator.xr);
  navigator.xr.requestSession = async (...parameters) => (session = await request(...parameters));
}
window.stgs = stgs;

window.show = (attributes) => {
  const player = document.createElement("stgs-player");
  window.player = player;
  window.events = [];
  for (const name of ["enterxr", "leavexr", "error"]) {
    player.addEventListener(name, () => window.events.push(name));
  }
  for (const [name, value] of Object.entries(attributes)) player.setAttribute(name, value);
  document.body.append(player);
  window.canvas = player.shadowRoot.querySelector("canvas");
};

/** Calls `work` after the player has drawn a frame of the session. */
const inFrame = (work) => new Promise((resolve) => {
  session.requestAnimationFrame((_, frame) => resolve(work(frame)));
});

window.hasSession = () => session !== null;
window.frames = async (count) => {
  for (let k = 0; k < count; ++k) await inFrame(() => undefined);
};

/** The images of both eyes, as the player has drawn them. */
const eyes = () => inFrame(() => {
  const gl = canvas.getContext("webgl2");
  const width = canvas.width / 2;
  return [0, 1].map((k) => readCanvas(gl, k * width, 0, width, canvas.height));
});

/** The smallest and the largest alpha of the left eye. */
window.alphas = async () => {
  const [left] = await eyes();
  const values = left.filter((_, i) => i % 4 === 3);
  return [Math.min(...values), Math.max(...values)];
};

/** The start camera of a scene that states none, as far as an eye has its properties. */
function frontOf({ boundsMin, boundsMax }) {
  const [x, y, z] = boundsMax.map((max, k) => (max + boundsMin[k]) / 2);
  const diagonal = Math.hypot(...boundsMax.map((max, k) => max - boundsMin[k]));
  return { rotation: [1, 0, 0, 0, 1, 0, 0, 0, 1], translation: [-x, -y, 1.2 * diagonal - z] };
}

/**
 * PSNR of both eyes to the plain renderer. The start camera is at (0, height, 0) of the room and
 * looks along -z, so an eye, whose axes are those of the room, is the start camera, moved.
 */
window.compareEyes = async (metresPerUnit, height, ipd, fovy) => {
  const { info } = player;
  const seconds = player.currentTime;
  const images = await eyes();
  const width = canvas.width / 2;
  const start = frontOf(info);
  const focal = canvas.height / 2 / Math.tan(fovy / 2);
  const { x, y, z } = device.position;
  const out = [];
  for (const [k, image] of images.entries()) {
    const side = (k === 0 ? -1 : 1) * ipd / 2;
    const [right, down, ahead] = [x + side, height - y, -z].map((value) => value / metresPerUnit);
    const [tx, ty, tz] = start.translation;
    const camera = {
      ...start, translation: [tx - right, ty - down, tz - ahead], fx: focal, fy: focal,
      cx: width / 2, cy: canvas.height / 2, width, height: canvas.height,
      near: 0.1 / metresPerUnit,
    };
    const expected = await plainImage("scene.stgs", camera, seconds, [...info.background, 1]);
    out.push(psnr(image, expected, width));
  }
  return out;
};

const turned = (camera, angle) => {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  const turn = ([a, b, d], [e, f, g]) => [c * a - s * e, c * b - s * f, c * d - s * g];
  const r = camera.rotation;
  const [x, y, z] = camera.translation;
  return {
    ...camera, translation: [c * x - s * z, y, s * x + c * z],
    rotation: [...turn(r.slice(0, 3), r.slice(6)), ...r.slice(3, 6),
               ...turn(r.slice(6), r.slice(0, 3).map((value) => -value))],
  };
};

/** PSNR of two eyes that are turned outwards by `angle` radians to the plain renderer. */
window.compareCanted = async (camera, angle) => {
  const { renderer, info } = await decode("scene.stgs", document.createElement("canvas"), 1);
  const ticks = 1 / info.tickSeconds;
  const gl = renderer.context;
  const views = [-1, 1].map((side, k) => ({
    x: k * camera.width, y: 0, camera: turned(camera, side * angle),
  }));
  gl.canvas.width = 2 * camera.width;
  gl.canvas.height = camera.height;
  for (let k = 0; k < 4; ++k) { // until the orders of these views have arrived
    renderer.renderViews(null, views, ticks, false);
    await new Promise((resolve) => setTimeout(resolve, 100));
  }
  renderer.renderViews(null, views, ticks, false);
  const images = views.map(({ x }) => readCanvas(gl, x, 0, camera.width, camera.height));
  const out = [];
  for (const [k, view] of views.entries()) {
    const expected = await plainImage("scene.stgs", view.camera, 1, [...info.background, 1]);
    out.push(psnr(images[k], expected, camera.width));
  }
  renderer.destroy();
  return out;
};

window.ready = true;
