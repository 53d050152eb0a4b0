// SPDX-License-Identifier: Apache-2.0
// A scene in WebGPURenderer of three.js. See test_three_gpu.py.
import * as THREE from "three";
import { StgsMesh } from "stgs/three";
import {
  BACKGROUND, BOX, CAMERA, compare, compareBoxes, countGpuObjects, delay, FAR, FOV, HEIGHT, imageOf, NEAR,
  textureImage, WIDTH,
} from "./engine_checks.js";
import { psnr } from "./decode_scene.js";

let renderer, scene, camera, counts;

const colorOf = ([r, g, b]) => new THREE.Color(`rgb(${r}, ${g}, ${b})`);

/** Whether this browser has an adapter for WebGPU. */
window.hasAdapter = async () => (await navigator.gpu?.requestAdapter() ?? null) !== null;

/** Begins a page with a renderer of these parameters. */
async function begin(parameters = {}) {
  renderer = new THREE.WebGPURenderer(parameters);
  renderer.setSize(WIDTH, HEIGHT);
  document.body.replaceChildren(renderer.domElement);
  await renderer.init();
  if (renderer.backend.isWebGPUBackend) counts = countGpuObjects(renderer.backend.device);
  scene = new THREE.Scene();
  scene.background = colorOf(BACKGROUND);
  camera = new THREE.PerspectiveCamera(FOV, WIDTH / HEIGHT, NEAR, FAR);
}

/** Adds a scene at a time, with y up as in three.js. Returns the mesh, which has an image. */
async function addScene(seconds) {
  const mesh = new StgsMesh({ renderer, src: "scene.stgs" });
  mesh.rotation.x = Math.PI;
  scene.add(mesh);
  mesh.player.currentTime = seconds;
  await new Promise((resolve, reject) => {
    mesh.player.addEventListener("seeked", resolve);
    mesh.player.addEventListener("error", () => reject(mesh.player.error));
  });
  while (mesh.player.hasImage === false) await delay(20);
  return mesh;
}

function addBox(distance, size = BOX.size, parameters = {}) {
  const material = new THREE.MeshBasicMaterial({ color: colorOf(BOX.color), ...parameters });
  const box = new THREE.Mesh(new THREE.BoxGeometry(size, size, size), material);
  box.position.z = -distance;
  scene.add(box);
  return box;
}

/** The image of the canvas. Call it in the task that has rendered. */
async function shownImage() {
  const { backend } = renderer;
  if (!backend.isWebGPUBackend) return imageOf(backend.gl);
  return textureImage(backend.device, backend.getContext().getCurrentTexture());
}

function render() {
  renderer.render(scene, camera);
  return shownImage();
}

async function finish() {
  if (renderer.backend.isWebGPUBackend) await renderer.backend.device.queue.onSubmittedWorkDone();
  await renderer.dispose();
}

window.compareAlone = async (parameters) => {
  await begin(parameters);
  await addScene(1);
  const value = await compare(await render(), CAMERA, 1);
  await finish();
  return value;
};

window.compareBoxes = async (parameters) => {
  await begin(parameters);
  const mesh = await addScene(1);
  const show = (isShown) => (mesh.visible = isShown);
  const placeBox = (distance, size) => {
    const box = addBox(distance, size);
    return () => scene.remove(box);
  };
  const out = await compareBoxes({ addBox: placeBox, show, render });
  await finish();
  return out;
};

/** A scene that is moved, turned and scaled, seen by a camera that moves along. */
window.compareMoved = async () => {
  await begin();
  const group = new THREE.Group();
  group.add(await addScene(1));
  scene.add(group);
  group.position.set(3, -1, 2);
  group.rotation.set(0.3, 0.7, -0.2);
  group.scale.setScalar(2.5);
  camera.near *= 2.5;
  camera.far *= 2.5;
  camera.updateProjectionMatrix();
  camera.position.copy(group.position);
  camera.rotation.copy(group.rotation);
  const value = await compare(await render(), CAMERA, 1);
  await finish();
  return value;
};

/**
 * Whether textured, lit and transparent objects around a scene out of sight are drawn as without it, and how
 * often the scene is drawn in passes with another material.
 */
window.compareState = async () => {
  await begin();
  const map = new THREE.DataTexture(new Uint8Array(64).map((_, i) => (i * 37) % 256), 4, 4);
  map.needsUpdate = true;
  const box = new THREE.Mesh(new THREE.BoxGeometry(0.3, 0.3, 0.3),
                             new THREE.MeshStandardMaterial({ map }));
  box.position.set(0, 0, -1);
  scene.add(box, new THREE.AmbientLight(0xffffff, 2));
  addBox(0.5, 0.1, { transparent: true, opacity: 0.5 });
  const expected = await render();
  const mesh = await addScene(1);
  mesh.position.z = 1000; // behind the camera
  mesh.frustumCulled = false;
  const image = await render();
  let draws = 0;
  mesh.player.draw = () => ++draws;
  scene.overrideMaterial = new THREE.MeshNormalMaterial();
  await render();
  await finish();
  return [image.every((value, i) => value === expected[i]), draws];
};

/** The colour in the middle of the splats, alone and behind a transparent box. */
window.compareTransparent = async () => {
  await begin();
  await addScene(1);
  const alone = await render();
  const middle = (image) => [...image.subarray(4 * (HEIGHT / 2 * WIDTH + WIDTH / 2))].slice(0, 3);
  addBox(BOX.before, BOX.size, { transparent: true, opacity: 0.5 });
  const before = middle(await render());
  await finish();
  return { alone: middle(alone), before };
};

/** Two views side by side in one frame: the PSNR of each to the middle of the whole image. */
window.compareViewports = async (parameters) => {
  await begin(parameters);
  await addScene(1);
  const whole = await render();
  const half = new THREE.PerspectiveCamera(FOV, WIDTH / 2 / HEIGHT, NEAR, FAR);
  renderer.autoClear = false;
  renderer.setScissorTest(true);
  renderer.clear();
  for (const x of [0, WIDTH / 2]) {
    renderer.setViewport(x, 0, WIDTH / 2, HEIGHT);
    renderer.setScissor(x, 0, WIDTH / 2, HEIGHT);
    renderer.render(scene, half);
  }
  const image = await shownImage();
  await finish();
  const columns = (bytes, first) => Uint8Array.from({ length: bytes.length / 2 }, (_, i) => {
    const row = Math.floor(i / (2 * WIDTH));
    return bytes[4 * (row * WIDTH + first) + i - 2 * WIDTH * row];
  });
  const expected = columns(whole, WIDTH / 4);
  return [0, WIDTH / 2].map((x) => psnr(columns(image, x), expected, WIDTH / 2));
};

function encoded(linear) {
  const colour = new THREE.Color();
  return Uint8Array.from(linear, (byte) => (
    Math.round(255 * colour.setRGB(byte / 255, 0, 0).convertLinearToSRGB().r)));
}

/** The PSNR of a canvas with linear colours, to which three.js draws without a pass in between. */
window.compareDirect = async (parameters) => {
  await begin(parameters);
  renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
  await addScene(1);
  const value = await compare(encoded(await render()), CAMERA, 1);
  await finish();
  return value;
};

/** The PSNR by a pass of a render pipeline, and that of the frame after a render target of another format. */
window.compareTargets = async () => {
  await begin();
  await addScene(1);
  const pipeline = new THREE.RenderPipeline(renderer);
  pipeline.outputNode = THREE.TSL.pass(scene, camera);
  pipeline.render();
  const pass = await compare(await shownImage(), CAMERA, 1);
  const target = new THREE.RenderTarget(WIDTH, HEIGHT, { samples: 4, type: THREE.UnsignedByteType });
  renderer.setRenderTarget(target);
  renderer.render(scene, camera);
  renderer.setRenderTarget(null);
  const linear = await renderer.readRenderTargetPixelsAsync(target, 0, 0, WIDTH, HEIGHT);
  const bytes = await compare(encoded(linear), CAMERA, 1);
  const canvas = await compare(await render(), CAMERA, 1);
  await finish();
  return { pass, bytes, canvas };
};

/** The PSNR of a transparent canvas over the colour of the background. */
window.compareClear = async () => {
  await begin();
  await addScene(1);
  scene.background = null;
  renderer.setClearColor(0, 0);
  const image = await render();
  const shown = image.map((byte, i) => {
    const alpha = image[i - (i % 4) + 3] / 255;
    return Math.round(byte + (1 - alpha) * (BACKGROUND[i % 4] ?? 255));
  });
  const value = await compare(shown, CAMERA, 1);
  await finish();
  return value;
};

/** Returns the objects of the device before a scene, with it and after it. */
window.countDisposed = async () => {
  await begin();
  addBox(BOX.before);
  await render();
  const out = [{ ...counts }];
  const mesh = await addScene(1);
  await render();
  out.push({ ...counts });
  scene.remove(mesh);
  mesh.dispose();
  mesh.dispose();
  await render();
  await delay(100);
  out.push({ ...counts });
  await finish();
  return out;
};

/** Whether playback changes the image, with events for drawing on demand. */
window.playSome = async () => {
  await begin();
  const mesh = await addScene(0);
  let changes = 0;
  mesh.addEventListener("change", () => {
    ++changes;
    renderer.render(scene, camera);
  });
  await mesh.player.play();
  for (let k = 0; k < 400 && (changes <= 3 || mesh.player.currentTime <= 0.2); ++k) await delay(100);
  const time = mesh.player.currentTime;
  mesh.player.pause();
  await delay(1000);
  const before = changes;
  await delay(300);
  mesh.dispose();
  await finish();
  return { changes, idle: changes - before, time };
};

/** Without WebGPU: mean differences of colour channels to the image with it, 0 to 255. */
window.compareFallback = async () => {
  await begin();
  await addScene(1);
  const expected = await render();
  await finish();
  await begin({ forceWebGL: true });
  await addScene(1);
  let image;
  for (let k = 0; k < 5; ++k) { // until the order has arrived
    image = await render();
    await delay(60);
  }
  const hidden = await (addBox(BOX.before), render());
  await finish();
  const mean = (a, b) => a.reduce((sum, value, i) => sum + Math.abs(value - b[i]), 0) / a.length;
  return { difference: mean(image, expected), middle: [...hidden.subarray(4 * (HEIGHT / 2 * WIDTH + WIDTH / 2))].slice(0, 3) };
};

window.messages = async () => {
  const messageOf = async (call) => {
    try {
      await call();
      return "";
    } catch (error) {
      return error.message;
    }
  };
  const uninitialized = await messageOf(
    () => new StgsMesh({ renderer: new THREE.WebGPURenderer() }));
  await begin({ forceWebGL: true, logarithmicDepthBuffer: true });
  const logarithmic = await messageOf(() => new StgsMesh({ renderer }));
  await begin();
  await addScene(1);
  const orthographic = await messageOf(() => renderer.render(scene, new THREE.OrthographicCamera()));
  await begin();
  const group = new THREE.BundleGroup();
  group.add(await addScene(1));
  scene.add(group);
  const bundle = await messageOf(render);
  return { uninitialized, logarithmic, orthographic, bundle };
};

window.ready = true;
