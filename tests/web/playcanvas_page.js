// SPDX-License-Identifier: Apache-2.0
// A scene in PlayCanvas. See test_playcanvas.py.
import * as pc from "playcanvas";
import { StgsScript } from "stgs/playcanvas";
import {
  BACKGROUND, BOX, CAMERA, changedState, compare, compareBoxes, countObjects, delay, FAR, FOV,
  HEIGHT, imageOf, NEAR, WIDTH,
} from "./engine_checks.js";

let app, camera, gl, counts;

const colorOf = ([r, g, b]) => new pc.Color(r / 255, g / 255, b / 255);

/** Begins a page with an application that renders on demand. */
async function begin() {
  const canvas = document.createElement("canvas");
  canvas.width = WIDTH;
  canvas.height = HEIGHT;
  document.body.replaceChildren(canvas);
  const options = { deviceTypes: [pc.DEVICETYPE_WEBGL2], antialias: false };
  const device = await pc.createGraphicsDevice(canvas, options);
  gl = device.gl;
  counts = countObjects(gl);
  app = new pc.AppBase(canvas);
  const settings = new pc.AppOptions();
  settings.graphicsDevice = device;
  settings.componentSystems = [
    pc.CameraComponentSystem, pc.LightComponentSystem, pc.RenderComponentSystem,
    pc.ScriptComponentSystem,
  ];
  app.init(settings);
  app.autoRender = false;
  app.start();
  camera = new pc.Entity("camera");
  camera.addComponent("camera", {
    clearColor: colorOf(BACKGROUND), fov: FOV, nearClip: NEAR, farClip: FAR,
    toneMapping: pc.TONEMAP_NONE,
  });
  app.root.addChild(camera);
}

/** Adds a scene at a time, with y up. Returns the script. */
async function addScene(seconds) {
  const entity = new pc.Entity("scene");
  entity.setLocalEulerAngles(180, 0, 0);
  entity.addComponent("script");
  app.root.addChild(entity);
  const script = entity.script.create(StgsScript, { properties: { src: "scene.stgs" } });
  script.player.currentTime = seconds;
  await new Promise((resolve, reject) => {
    script.player.addEventListener("seeked", resolve);
    script.player.addEventListener("error", () => reject(script.player.error));
  });
  return script;
}

function addBox(distance, size = BOX.size, color = BOX.color) {
  const box = new pc.Entity("box");
  const material = new pc.StandardMaterial();
  material.useLighting = false;
  material.emissive = colorOf(color);
  material.update();
  box.addComponent("render", { type: "box", material });
  box.setLocalScale(size, size, size);
  box.setPosition(0, 0, -distance);
  app.root.addChild(box);
  return box;
}

/** Renders until the order has arrived. Returns the image. */
async function render() {
  let image = null;
  const read = () => (image = imageOf(gl));
  app.scene.on("postrender", read);
  for (let k = 0; k < 5; ++k) {
    app.renderNextFrame = true;
    await delay(80);
  }
  app.scene.off("postrender", read);
  return image;
}

function finish() {
  const error = gl.getError();
  app.destroy();
  if (error !== 0) throw new Error(`WebGL error ${error}`);
}

window.compareAlone = async () => {
  await begin();
  await addScene(1);
  const value = await compare(await render(), CAMERA, 1);
  finish();
  return value;
};

window.compareBoxes = async () => {
  await begin();
  const { entity } = await addScene(1);
  const show = (isShown) => (entity.enabled = isShown);
  const placeBox = (distance, size) => {
    const box = addBox(distance, size);
    return () => box.destroy();
  };
  const out = await compareBoxes({ addBox: placeBox, show, render });
  finish();
  return out;
};

/** A scene that is moved, turned and scaled, seen by a camera that moves along. */
window.compareMoved = async () => {
  await begin();
  const { entity } = await addScene(1);
  const group = new pc.Entity("group");
  app.root.addChild(group);
  entity.reparent(group);
  camera.reparent(group);
  group.setPosition(3, -1, 2);
  group.setEulerAngles(17, 40, -11);
  group.setLocalScale(2.5, 2.5, 2.5);
  camera.camera.nearClip *= 2.5;
  camera.camera.farClip *= 2.5;
  const value = await compare(await render(), CAMERA, 1);
  finish();
  return value;
};

/**
 * Whether objects around a scene are drawn as without it, how often it is drawn out of sight, and the
 * state of the context that drawing it changes.
 */
window.compareState = async () => {
  await begin();
  addBox(2, 0.5, [90, 200, 30]);
  const glass = addBox(1, 0.2, [200, 200, 20]);
  glass.render.material.blendType = pc.BLEND_NORMAL;
  glass.render.material.opacity = 0.5;
  glass.render.material.update();
  const expected = await render();
  const { entity, player } = await addScene(1);
  const draw = player.draw, changed = [];
  player.draw = (view) => { // into no pixel
    gl.enable(gl.SCISSOR_TEST);
    const box = gl.getParameter(gl.SCISSOR_BOX);
    gl.scissor(0, 0, 0, 0);
    changed.push(...changedState(gl, () => draw.call(player, view)));
    gl.scissor(...box);
  };
  const image = await render();
  const isSame = image.every((value, i) => value === expected[i]);
  entity.setPosition(0, 0, 500); // behind the camera
  let draws = 0;
  player.draw = () => ++draws;
  await render();
  finish();
  return [isSame, draws, changed];
};

/** Returns the objects of the context before a scene, with it and after it. */
window.countDestroyed = async () => {
  await begin();
  addBox(BOX.before);
  await render();
  const out = [{ ...counts }];
  const { entity } = await addScene(1);
  await render();
  out.push({ ...counts });
  entity.destroy();
  await delay(100);
  await render();
  out.push({ ...counts });
  finish();
  return out;
};

/** Whether playback draws frames, for applications that draw on demand. */
window.playSome = async () => {
  await begin();
  const { player } = await addScene(0);
  let frames = 0;
  app.scene.on("postrender", () => ++frames);
  await player.play();
  for (let k = 0; k < 100 && (frames <= 3 || player.currentTime <= 0.2); ++k) await delay(100);
  const time = player.currentTime;
  player.pause();
  finish();
  return { frames, time };
};

window.ready = true;
