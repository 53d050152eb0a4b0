// SPDX-License-Identifier: Apache-2.0
// Frame times of a static scene: this renderer and that of PlayCanvas. See bench_frames.py.
import * as pc from "playcanvas";
import { decode, psnr, readCanvas } from "./decode_scene.js";

const NEAR = 0.05, FAR = 100;
const median = (values) => values.sort((a, b) => a - b)[values.length >> 1];

/** Waits until the GPU has drawn: reads a pixel of the canvas. */
function finish(gl) {
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
}

/** The angle of a frame, about the vertical axis: the camera swings, so that orders change. */
const angle = (frame) => 0.05 * Math.sin(frame);

function makeCanvas(width, height) {
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  document.body.replaceChildren(canvas);
  return canvas;
}

/** Draws `frames` with this project's renderer. Returns milliseconds of the median, and the image. */
async function ours({ renderer: name, width, height, focal, frames }) {
  const canvas = makeCanvas(width, height);
  const { renderer } = await decode("static.stgs", canvas, 0, name === "webgpu" ? name : undefined);
  const camera = (frame) => {
    const a = angle(frame), c = Math.cos(a), s = Math.sin(a);
    return { rotation: [c, 0, s, 0, 1, 0, -s, 0, c], translation: [0, 0, 0], fx: focal, fy: focal,
             cx: width / 2, cy: height / 2, width, height, near: NEAR };
  };
  const isWebGl = name === "webgl2", gl = isWebGl ? canvas.getContext("webgl2") : null;
  await renderer.renderExactly(camera(0), 0);
  const times = [];
  for (let frame = 0; frame < frames; ++frame) {
    await new Promise(requestAnimationFrame);
    const begin = performance.now();
    renderer.render(camera(frame), 0);
    if (isWebGl) finish(gl);
    else await renderer.readPixels();
    times.push(performance.now() - begin);
  }
  await renderer.renderExactly(camera(0), 0);
  const image = isWebGl ? readCanvas(gl, 0, 0, width, height) : null;
  renderer.destroy();
  return { ms: median(times), image };
}

/** The same with the splats of PlayCanvas. */
async function playCanvas({ width, height, focal, frames }) {
  const canvas = makeCanvas(width, height);
  const device = await pc.createGraphicsDevice(canvas, { deviceTypes: [pc.DEVICETYPE_WEBGL2], antialias: false });
  const { gl } = device;
  const app = new pc.AppBase(canvas);
  const settings = new pc.AppOptions();
  settings.graphicsDevice = device;
  settings.componentSystems = [pc.CameraComponentSystem, pc.GSplatComponentSystem];
  settings.resourceHandlers = [pc.GSplatHandler];
  app.init(settings);
  app.start();
  const camera = new pc.Entity("camera");
  camera.addComponent("camera", {
    clearColor: new pc.Color(0, 0, 0), fov: 2 * Math.atan(height / 2 / focal) * 180 / Math.PI,
    nearClip: NEAR, farClip: FAR, toneMapping: pc.TONEMAP_NONE,
  });
  const asset = new pc.Asset("scene", "gsplat", { url: "scene.ply" });
  app.assets.add(asset);
  await new Promise((resolve, reject) => {
    asset.once("load", resolve);
    asset.once("error", reject);
    app.assets.load(asset);
  });
  const splats = new pc.Entity("splats");
  splats.setLocalEulerAngles(180, 0, 0);
  splats.addComponent("gsplat", { asset });
  for (const entity of [camera, splats]) app.root.addChild(entity);
  const times = [];
  let image = null, frame = -30; // it sorts and uploads before the first one that counts
  await new Promise((resolve) => {
    let begin = 0;
    app.on("frameupdate", () => {
      begin = performance.now();
      camera.setLocalEulerAngles(0, angle(Math.min(Math.max(frame, 0), frames)) * 180 / Math.PI, 0);
      if (frame > frames) camera.setLocalEulerAngles(0, 0, 0);
    });
    app.on("frameend", () => {
      finish(gl);
      if (frame >= 0 && frame < frames) times.push(performance.now() - begin);
      if (++frame < frames + 30) return;
      image = readCanvas(gl, 0, 0, width, height);
      resolve();
    });
  });
  app.destroy();
  return { ms: median(times), image };
}

window.measure = async (job) => {
  const peer = await playCanvas(job), own = await ours(job);
  return {
    playcanvas_ms: peer.ms, stgs_ms: own.ms, ratio: own.ms / peer.ms,
    psnr_db: own.image === null ? null : psnr(own.image, peer.image, job.width),
  };
};
window.ready = true;
