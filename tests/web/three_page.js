// SPDX-License-Identifier: Apache-2.0
// A scene in three.js. See test_three.py.
import * as THREE from "three";
import { StgsMesh } from "stgs/three";
import {
  BACKGROUND, BOX, CAMERA, changedState, compare, compareBoxes, countObjects, delay, FAR, FOV,
  HEIGHT, imageOf, NEAR, WIDTH,
} from "./engine_checks.js";
import { plainImage, psnr, readCanvas } from "./decode_scene.js";

let renderer, scene, camera, counts;

const colorOf = ([r, g, b]) => new THREE.Color(`rgb(${r}, ${g}, ${b})`);

/** Begins a page with a renderer of these parameters. */
window.begin = (parameters = {}) => {
  renderer = new THREE.WebGLRenderer({ antialias: false, ...parameters });
  renderer.setSize(WIDTH, HEIGHT);
  document.body.replaceChildren(renderer.domElement);
  counts = countObjects(renderer.getContext());
  scene = new THREE.Scene();
  scene.background = colorOf(BACKGROUND);
  camera = new THREE.PerspectiveCamera(FOV, WIDTH / HEIGHT, NEAR, FAR);
};

/** Adds a scene at a time, with y up as in three.js. Returns the mesh. */
async function addScene(seconds, options = {}) {
  const mesh = new StgsMesh({ renderer, src: "scene.stgs", ...options });
  mesh.rotation.x = Math.PI;
  scene.add(mesh);
  mesh.player.currentTime = seconds;
  await new Promise((resolve, reject) => {
    mesh.player.addEventListener("seeked", resolve);
    mesh.player.addEventListener("error", () => reject(mesh.player.error));
  });
  return mesh;
}

function addBox(distance, size = BOX.size) {
  const material = new THREE.MeshBasicMaterial({ color: colorOf(BOX.color) });
  const box = new THREE.Mesh(new THREE.BoxGeometry(size, size, size), material);
  box.position.z = -distance;
  scene.add(box);
  return box;
}

/** Renders until the order has arrived. Returns the image. */
async function render() {
  for (let k = 0; k < 4; ++k) {
    renderer.render(scene, camera);
    await delay(60);
  }
  renderer.render(scene, camera);
  return imageOf(renderer.getContext());
}

const finish = () => {
  const error = renderer.getContext().getError();
  renderer.dispose();
  if (error !== 0) throw new Error(`WebGL error ${error}`);
};

window.compareAlone = async (parameters) => {
  begin(parameters);
  const mesh = await addScene(1);
  const value = await compare(await render(), CAMERA, 1);
  mesh.dispose();
  finish();
  return value;
};

window.compareBoxes = async (parameters) => {
  begin(parameters);
  const mesh = await addScene(1);
  const show = (isShown) => (mesh.visible = isShown);
  const placeBox = (distance, size) => {
    const box = addBox(distance, size);
    return () => scene.remove(box);
  };
  const out = await compareBoxes({ addBox: placeBox, show, render });
  finish();
  return out;
};

/** A scene that is moved, turned and scaled, seen by a camera that moves along. */
window.compareMoved = async () => {
  begin();
  const mesh = await addScene(1);
  const group = new THREE.Group();
  group.add(mesh);
  scene.add(group);
  group.position.set(3, -1, 2);
  group.rotation.set(0.3, 0.7, -0.2);
  group.scale.setScalar(2.5);
  group.add(camera);
  camera.near *= 2.5;
  camera.far *= 2.5;
  camera.updateProjectionMatrix();
  group.updateMatrixWorld(true);
  // The view matrix of a camera has no scale in three.js.
  camera.matrixWorldAutoUpdate = false;
  camera.matrixWorld.makeRotationFromEuler(group.rotation).setPosition(group.position);
  camera.matrixWorldInverse.copy(camera.matrixWorld).invert();
  const value = await compare(await render(), CAMERA, 1);
  finish();
  return value;
};

/**
 * Whether textured and lit objects around a scene are drawn as without it, how often the scene is
 * drawn in passes with another material, and the state of the context that drawing it changes.
 */
window.compareState = async () => {
  begin();
  const data = new Uint8Array(64).map((_, i) => (i * 37) % 256);
  const map = new THREE.DataTexture(data, 4, 4);
  map.needsUpdate = true;
  map.flipY = true;
  const box = new THREE.Mesh(new THREE.BoxGeometry(0.3, 0.3, 0.3),
                             new THREE.MeshStandardMaterial({ map }));
  box.position.set(0, 0, -1);
  const glass = new THREE.Mesh(new THREE.BoxGeometry(0.1, 0.1, 0.1),
                               new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.5 }));
  glass.position.set(0.1, 0, -0.5);
  scene.add(box, glass, new THREE.AmbientLight(0xffffff, 2));
  const expected = await render();
  const mesh = await addScene(1);
  const changed = [];
  mesh.onBeforeRender = new Proxy(mesh.onBeforeRender, {
    // The splats are drawn into no pixel, so that the rest has to be as before.
    apply: (draw, self, parameters) => {
      const gl = renderer.getContext();
      gl.enable(gl.SCISSOR_TEST);
      gl.scissor(0, 0, 0, 0);
      changed.push(...changedState(gl, () => draw.apply(self, parameters)));
      gl.disable(gl.SCISSOR_TEST);
    },
  });
  const image = await render();
  const isSame = image.every((value, i) => value === expected[i]);
  let draws = 0;
  mesh.player.draw = () => ++draws;
  scene.overrideMaterial = new THREE.MeshNormalMaterial();
  await render();
  finish();
  return [isSame, draws, changed];
};

/** Two scenes at once, in a target with linear colours. */
window.compareLinear = async () => {
  begin();
  const first = await addScene(1);
  const alone = await render();
  const target = new THREE.WebGLRenderTarget(WIDTH, HEIGHT, { type: THREE.HalfFloatType });
  const second = await addScene(1);
  second.position.z = 1000; // behind the camera
  for (let k = 0; k < 5; ++k) {
    renderer.setRenderTarget(target);
    renderer.render(scene, camera);
    renderer.setRenderTarget(null);
    await delay(60);
  }
  const show = new THREE.Scene();
  const plane = new THREE.Mesh(new THREE.PlaneGeometry(2, 2),
                               new THREE.MeshBasicMaterial({ map: target.texture }));
  plane.position.z = -1;
  show.add(plane);
  renderer.render(show, new THREE.OrthographicCamera());
  const image = imageOf(renderer.getContext());
  const mean = (bytes) => bytes.reduce((sum, value) => sum + value, 0) / bytes.length;
  finish();
  return [mean(alone), mean(image), first.player !== second.player];
};

/** Returns the objects of the context before a scene, with it and after it. */
window.countDisposed = async () => {
  begin();
  addBox(BOX.before);
  await render();
  const out = [{ ...counts }];
  const mesh = await addScene(1);
  await render();
  out.push({ ...counts });
  scene.remove(mesh);
  mesh.dispose();
  mesh.dispose();
  await delay(100);
  out.push({ ...counts });
  finish();
  return out;
};

window.compareRestored = async () => {
  begin();
  await addScene(1);
  await render();
  renderer.forceContextLoss();
  await delay(100);
  renderer.forceContextRestore();
  await delay(500);
  return compare(await render(), CAMERA, 1);
};

/** Whether playback changes the image, with events for drawing on demand. */
window.playSome = async () => {
  begin();
  const mesh = await addScene(0, { quality: "medium", device: "headset" });
  let changes = 0;
  mesh.addEventListener("change", () => {
    ++changes;
    renderer.render(scene, camera);
  });
  await mesh.player.play();
  await delay(700);
  const time = mesh.player.currentTime;
  mesh.player.pause();
  let idle = 1;
  for (let k = 0; k < 20 && idle > 0; ++k) { // until the order of the last frame has arrived
    const before = changes;
    await delay(300);
    idle = changes - before;
  }
  const report = mesh.player.qualityReport;
  mesh.dispose();
  finish();
  return { changes, idle, time, report };
};

/** PSNR of each eye of an emulated headset at the origin to the plain player. */
window.compareEyes = async () => {
  const { metaQuest3, XRDevice } = await import("./iwer.js");
  const device = new XRDevice(metaQuest3);
  device.installRuntime({ forceInstall: true });
  device.stereoEnabled = true;
  device.ipd = 0.06;
  device.fovy = FOV * Math.PI / 180;
  device.position.set(0, 0, 0);
  begin();
  await addScene(1);
  renderer.xr.enabled = true;
  renderer.xr.setReferenceSpaceType("local-floor");
  const session = await navigator.xr.requestSession("immersive-vr", {
    optionalFeatures: ["local-floor"],
  });
  await renderer.xr.setSession(session);
  const gl = renderer.getContext();
  const images = await new Promise((resolve) => {
    let frames = 0;
    renderer.setAnimationLoop(() => {
      renderer.render(scene, camera);
      if (++frames < 10) return;
      renderer.setAnimationLoop(null);
      const { width, height } = gl.canvas; // iwer has set it
      resolve([0, 1].map((k) => readCanvas(gl, k * width / 2, 0, width / 2, height)));
    });
  });
  const { width, height } = gl.canvas;
  await session.end();
  finish();
  const focal = height / 2 / Math.tan(device.fovy / 2);
  const out = [];
  for (const [k, image] of images.entries()) {
    const eye = {
      ...CAMERA, translation: [k === 0 ? 0.03 : -0.03, 0, 0], fx: focal, fy: focal,
      cx: width / 4, cy: height / 2, width: width / 2, height,
    };
    const background = [...BACKGROUND.map((value) => value / 255), 1];
    out.push(psnr(image, await plainImage("scene.stgs", eye, 1, background), eye.width));
  }
  return out;
};

window.messages = () => {
  begin();
  const out = [];
  try {
    new StgsMesh({ renderer: {} });
  } catch (error) {
    out.push(error.message);
  }
  const mesh = new StgsMesh({ renderer });
  try {
    const { geometry, material } = mesh;
    mesh.onBeforeRender(renderer, scene, new THREE.OrthographicCamera(), geometry, material);
  } catch (error) {
    out.push(error.message);
  }
  mesh.dispose();
  return out;
};

window.ready = true;
