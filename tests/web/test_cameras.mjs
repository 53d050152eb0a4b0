// SPDX-License-Identifier: Apache-2.0
// Cameras keep valid poses, their centre, their limits and the field of view.
import assert from "node:assert/strict";
import { test } from "node:test";
import { importSource } from "./import_source.mjs";
import { INFO } from "./player_fakes.mjs";

const cameras = await importSource("src/element/cameras/index.ts");
const { DragGestures, FlyCamera, FlyKeys, OrbitCamera, PadReader } = cameras;
const DEGREES = Math.PI / 180;
const SIZE = [640, 360];
const NO_DRIVE = { right: 0, up: 0, forward: 0, turnRight: 0, turnUp: 0, boost: 1 };

const near = (a, b, tolerance = 1e-9) =>
  assert.ok(Math.abs(a - b) <= tolerance, `${a} is not ${b}`);
const row = ({ rotation: r }, i) => r.slice(3 * i, 3 * i + 3);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const column = (c, k) => [0, 1, 2].map((i) => row(c, i)[k]);
const position = (c) => [0, 1, 2].map((k) => -dot(column(c, k), c.translation));
const inCamera = (c, p) => [0, 1, 2].map((i) => dot(row(c, i), p) + c.translation[i]);
const viewOf = (rig) => rig.camera(...SIZE);

function checkPose(camera) {
  for (let i = 0; i < 3; ++i) {
    for (let j = 0; j < 3; ++j) near(dot(row(camera, i), row(camera, j)), i === j ? 1 : 0, 1e-12);
  }
  const [x, y, z] = [0, 1, 2].map((i) => row(camera, i));
  near(x[0] * y[1] - x[1] * y[0], z[2], 1e-12);
}

/** Updates a rig each 20 ms until it rests. Returns the number of updates. */
function runToRest(rig, limit = 500) {
  let time = 0, steps = 0;
  while (rig.update(time) && steps < limit) {
    time += 20;
    ++steps;
  }
  return steps;
}

/** Records the calls of gestures. */
function recorder() {
  const calls = [];
  const record = (name) => (...values) => calls.push([name, ...values]);
  return {
    calls, rotate: record("rotate"), pan: record("pan"), zoom: record("zoom"),
    grab: () => undefined, release: record("release"),
  };
}

test("cameras begin at the start camera", () => {
  for (const rig of [new OrbitCamera(INFO), new FlyCamera(INFO)]) {
    const camera = viewOf(rig);
    const { rotation, translation } = INFO.startCamera;
    rotation.forEach((value, i) => near(camera.rotation[i], value));
    translation.forEach((value, i) => near(camera.translation[i], value));
    assert.equal(rig.update(0), false);
  }
});

test("an orbit keeps its centre on the optical axis, at its distance", () => {
  const rig = new OrbitCamera(INFO, { free: true });
  for (let i = 0; i < 1000; ++i) rig.rotate(0.037 * i, 0.1 * Math.sin(i));
  const camera = viewOf(rig);
  checkPose(camera);
  const [x, y, z] = inCamera(camera, [0, 0, 0]);
  near(x, 0);
  near(y, 0);
  near(z, 5);
});

test("dragging moves the content with the pointer", () => {
  const point = [0.2, 0.1, -1]; // in front of the centre
  for (const rig of [new OrbitCamera(INFO), new FlyCamera(INFO)]) {
    const [x, y] = inCamera(viewOf(rig), point);
    rig.rotate(0.1, 0);
    assert.ok(inCamera(viewOf(rig), point)[0] > x);
    rig.reset();
    rig.rotate(0, 0.1);
    assert.ok(inCamera(viewOf(rig), point)[1] < y);
    rig.reset();
    rig.pan(0.1, 0.05);
    const moved = inCamera(viewOf(rig), [0, 0, 0]);
    near(moved[0] / moved[2] * 500 / 640, 0.1);
    near(moved[1] / moved[2] * 500 / 640, -0.05);
  }
});

test("the limits of an orbit are the field of view, and free lifts them", () => {
  const rig = new OrbitCamera(INFO);
  near(rig.limits.azimuth, 2 * Math.atan(320 / 500));
  near(rig.limits.elevation, Math.atan(180 / 500));
  rig.rotate(-10, 10);
  const forward = row(viewOf(rig), 2);
  near(Math.asin(-forward[1]), rig.limits.elevation);
  near(Math.atan2(-forward[0], forward[2]), rig.limits.azimuth);
  rig.zoom(100);
  near(Math.hypot(...position(viewOf(rig))), 8);
  rig.zoom(1e-9);
  near(Math.hypot(...position(viewOf(rig))), 1.5);
  rig.reset();
  rig.pan(10, 0);
  near(Math.hypot(...position(viewOf(rig)).slice(0, 2)), 2);
  const free = new OrbitCamera(INFO, { free: true });
  free.rotate(Math.PI, 0);
  near(position(viewOf(free))[2], 5);
});

test("a narrow field of view still leaves 20 degrees", () => {
  const startCamera = { ...INFO.startCamera, fx: 1e5, fy: 1e5 };
  const { limits } = new OrbitCamera({ ...INFO, startCamera });
  near(limits.azimuth, 20 * DEGREES);
  near(limits.elevation, 10 * DEGREES);
});

test("an orbit does not roll", () => {
  const rig = new OrbitCamera(INFO, { free: true });
  for (let i = 0; i < 100; ++i) {
    rig.rotate(0.3, 0.2 * Math.cos(i));
    near(row(viewOf(rig), 0)[1], 0, 1e-12);
  }
});

test("an orbit turns around the up vector of the scene", () => {
  const [c, s] = [Math.cos(0.4), Math.sin(0.4)]; // a start camera that looks down
  const startCamera = { ...INFO.startCamera, rotation: [1, 0, 0, 0, c, -s, 0, s, c] };
  const heights = [null, [0, -1, 0]].map((up) => {
    const rig = new OrbitCamera({ ...INFO, startCamera, up }, { reducedMotion: true });
    const height = () => {
      const { rotation: r, translation: t } = rig.camera(640, 360);
      return -(r[1] * t[0] + r[4] * t[1] + r[7] * t[2]);
    };
    const before = height();
    rig.rotate(0.3, 0);
    rig.update(1);
    return Math.abs(height() - before);
  });
  assert.ok(heights[0] > 1e-3);
  near(heights[1], 0, 1e-9);
});

test("the larger side keeps the field of view", () => {
  const rig = new OrbitCamera(INFO);
  for (const [width, height] of [[1280, 720], [360, 640], [500, 500], [1, 1]]) {
    const camera = rig.camera(width, height);
    near(camera.fx, (500 * Math.max(width, height)) / 640);
    near(camera.fx, camera.fy);
    near(camera.cx, width / 2);
    near(camera.cy, height / 2);
    assert.deepEqual([camera.width, camera.height], [width, height]);
  }
});

test("the principal point keeps its offset from the middle", () => {
  const startCamera = { ...INFO.startCamera, cx: 330, cy: 170 };
  const camera = new OrbitCamera({ ...INFO, startCamera }).camera(1280, 720);
  near(camera.cx, 660);
  near(camera.cy, 340);
});

test("a scene without a start camera is seen completely", () => {
  const info = { ...INFO, startCamera: null, boundsMin: [1, 2, 3], boundsMax: [3, 6, 5] };
  const camera = new OrbitCamera(info).camera(1280, 720);
  for (const x of [1, 3]) {
    for (const y of [2, 6]) {
      for (const z of [3, 5]) {
        const p = inCamera(camera, [x, y, z]);
        assert.ok(p[2] > camera.near);
        assert.ok(Math.abs((camera.fy * p[1]) / p[2]) < 360);
      }
    }
  }
});

test("inertia continues a drag and ends; reduced motion has none", () => {
  for (const Rig of [OrbitCamera, FlyCamera]) {
    const rig = new Rig(INFO);
    rig.update(0);
    rig.release(2, 0);
    const steps = runToRest(rig);
    assert.ok(steps > 10 && steps < 100, `${steps} steps`);
    assert.ok(Math.abs(row(viewOf(rig), 2)[0]) > 0.1);
    const still = new Rig(INFO, { reducedMotion: true });
    still.release(2, 0);
    assert.equal(runToRest(still), 0);
    const grabbed = new Rig(INFO);
    grabbed.release(2, 0);
    grabbed.grab();
    assert.equal(runToRest(grabbed), 0);
  }
});

test("flying moves along the axes of the camera", () => {
  const rig = new FlyCamera(INFO);
  rig.rotate(-Math.PI / 2, 0); // looks to the right, along +x
  rig.drive({ right: 0, up: 0, forward: 1, turnRight: 0, turnUp: 0, boost: 1 });
  for (let t = 0; t <= 1000; t += 20) assert.equal(rig.update(t), true);
  const [x, y, z] = position(viewOf(rig));
  near(x, 2.5, 1e-6); // half the distance of 5 per second
  near(y, 0);
  near(z, -5);
  rig.update(60000); // a sleep of the page is no flight
  near(position(viewOf(rig))[0], 2.75, 1e-6);
  checkPose(viewOf(rig));
});

test("pitch stops short of the vertical", () => {
  const rig = new FlyCamera(INFO);
  rig.rotate(0, -10);
  near(Math.asin(-row(viewOf(rig), 2)[1]), 1.5);
});

test("keys combine, and shift is faster", () => {
  const keys = new FlyKeys();
  assert.equal(keys.down("KeyW", false), true);
  assert.equal(keys.down("KeyA", true), true);
  assert.equal(keys.down("KeyK", false), false);
  keys.down("KeyA", true);
  const { forward, right, boost } = keys.drive();
  assert.deepEqual([forward, right, boost], [1, -1, 4]);
  assert.equal(keys.up("KeyW", false), true);
  keys.down("KeyD", false);
  assert.equal(keys.drive().right, 0);
  keys.clear();
  assert.deepEqual(keys.drive(), NO_DRIVE);
});

test("one pointer rotates, and its speed is released", () => {
  const rig = recorder();
  const drag = new DragGestures(rig, () => 600);
  drag.down({ id: 1, x: 0, y: 0, time: 0, pans: false });
  for (let i = 1; i <= 5; ++i) drag.move({ id: 1, x: 10 * i, y: -5 * i, time: 16 * i });
  assert.deepEqual(rig.calls[0], ["rotate", 0.04, 0.02]);
  assert.equal(drag.up({ id: 1, time: 80 }), false);
  const [name, right, up] = rig.calls.pop();
  assert.equal(name, "release");
  near(right, (50 / 600) * 2.4 / 0.08);
  near(up, right / 2);
});

test("a drag that stops before the release has no speed", () => {
  const rig = recorder();
  const drag = new DragGestures(rig, () => 600);
  drag.down({ id: 1, x: 0, y: 0, time: 0, pans: false });
  drag.move({ id: 1, x: 50, y: 0, time: 16 });
  drag.up({ id: 1, time: 500 });
  assert.ok(rig.calls.every(([name]) => name !== "release"));
});

test("two pointers pan and pinch, and the second ends the tap", () => {
  const rig = recorder();
  const drag = new DragGestures(rig, () => 600);
  drag.down({ id: 1, x: 100, y: 100, time: 0, pans: false });
  drag.down({ id: 2, x: 200, y: 100, time: 5, pans: false });
  drag.move({ id: 2, x: 300, y: 100, time: 20 });
  assert.deepEqual(rig.calls, [["pan", 50 / 600, -0], ["zoom", 0.5]]);
  assert.equal(drag.up({ id: 2, time: 30 }), false);
  drag.move({ id: 1, x: 110, y: 100, time: 40 });
  assert.equal(rig.calls.pop()[0], "rotate");
  assert.equal(drag.up({ id: 1, time: 50 }), false);
  assert.equal(drag.active, false);
});

test("a press without a drag is a tap", () => {
  const drag = new DragGestures(recorder(), () => 600);
  drag.down({ id: 1, x: 0, y: 0, time: 0, pans: false });
  drag.move({ id: 1, x: 2, y: 1, time: 10 });
  assert.equal(drag.up({ id: 1, time: 20 }), true);
  drag.down({ id: 1, x: 0, y: 0, time: 0, pans: false });
  drag.cancel();
  assert.equal(drag.up({ id: 1, time: 20 }), false);
  assert.equal(drag.move({ id: 1, x: 2, y: 1, time: 10 }), false);
});

test("a pointer that pans does not rotate", () => {
  const rig = recorder();
  const drag = new DragGestures(rig, () => 600);
  drag.down({ id: 1, x: 0, y: 0, time: 0, pans: true });
  drag.move({ id: 1, x: 60, y: 30, time: 10 });
  drag.up({ id: 1, time: 20 });
  assert.deepEqual(rig.calls, [["pan", 0.1, -0.05]]);
});

test("a gamepad has dead zones, and a button acts once per press", () => {
  const reader = new PadReader();
  const buttons = (...pressed) =>
    Array.from({ length: 17 }, (_, i) => ({ pressed: pressed.includes(i), value: 0 }));
  const idle = reader.read({ axes: [0.1, -0.05, 0, 0], buttons: buttons() });
  assert.deepEqual(idle.drive, NO_DRIVE);
  const { drive, actions } = reader.read({ axes: [0, -1, 1, 0], buttons: buttons(0, 5, 14) });
  assert.deepEqual(drive, { right: 0, up: 1, forward: 1, turnRight: 1, turnUp: 0, boost: 1 });
  assert.deepEqual(actions, ["toggle", "back"]);
  assert.deepEqual(reader.read({ axes: [], buttons: buttons(0) }).actions, []);
  reader.read({ axes: [], buttons: buttons() });
  assert.deepEqual(reader.read({ axes: [], buttons: buttons(0) }).actions, ["toggle"]);
});

test("a stick orbits in its direction", () => {
  const rig = new OrbitCamera(INFO);
  rig.drive({ right: 0, up: 0, forward: 0, turnRight: 1, turnUp: 0, boost: 1 });
  rig.update(0);
  rig.update(100);
  assert.ok(position(viewOf(rig))[0] > 0);
});
