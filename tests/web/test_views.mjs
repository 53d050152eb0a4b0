// SPDX-License-Identifier: Apache-2.0
// Cameras of matrices, orders of several views, and the place of a scene in a room.
import assert from "node:assert/strict";
import { test } from "node:test";
import { importSource } from "./import_source.mjs";

const { centreOf } = await importSource("src/camera.ts");
const { cameraOfMatrices, product, sharedCamera } = await importSource("src/webgl2/camera.ts");
const { roomFromScene } = await importSource("src/xr/placement.ts");

const close = (a, b, tolerance = 1e-9) =>
  a.forEach((value, k) => assert.ok(Math.abs(value - b[k]) < tolerance, `${a} and ${b}`));

/** Applies a matrix to a point; the result is homogeneous. */
const apply = (m, [x, y, z, w = 1]) =>
  [0, 1, 2, 3].map((row) => m[row] * x + m[4 + row] * y + m[8 + row] * z + m[12 + row] * w);

/** The OpenGL projection of a frustum, by its edges at distance 1. */
function frustum(left, right, bottom, top, near, far) {
  return [
    2 / (right - left), 0, 0, 0, 0, 2 / (top - bottom), 0, 0,
    (right + left) / (right - left), (top + bottom) / (top - bottom),
    -(far + near) / (far - near), -1, 0, 0, (-2 * far * near) / (far - near), 0,
  ];
}

const [c, s] = [Math.cos(0.4), Math.sin(0.4)];
const TURNED = [2 * c, 0, -2 * s, 0, 0, 3, 0, 0, s, 0, c, 0, 0.5, -1, -6, 1]; // scales, too

function toCamera({ rotation, translation }, [x, y, z]) {
  return [0, 1, 2].map((k) => rotation[3 * k] * x + rotation[3 * k + 1] * y +
                              rotation[3 * k + 2] * z + translation[k]);
}

test("a camera projects points as the matrices of an asymmetric view do", () => {
  const projection = frustum(-1.2, 0.7, -0.6, 1.1, 0.1, 50);
  for (const flip of [1, -1]) {
    const flipped = projection.map((value, k) => (k % 4 === 1 ? flip * value : value));
    const camera = cameraOfMatrices(flipped, TURNED, 640, 480, 0.1);
    assert.ok(camera.fx > 0 && camera.fy > 0);
    for (const point of [[0, 0, 0], [0.3, -0.2, 1], [-1, 0.4, 0.5]]) {
      const [x, y, , w] = apply(flipped, apply(TURNED, point));
      const [cx, cy, z] = toCamera(camera, point);
      close([camera.fx * cx / z + camera.cx, camera.fy * cy / z + camera.cy],
            [320 * (1 + x / w), 240 * (1 - y / w)]);
      close([z], [w]);
    }
  }
});

test("the centre of a camera with a scale is where it sees all from", () => {
  const camera = cameraOfMatrices(frustum(-1, 1, -1, 1, 0.1, 9), TURNED, 64, 64, 0.1);
  close(toCamera(camera, centreOf(camera)), [0, 0, 0]);
});

test("one order serves views with parallel axes, and the mean depth of others", () => {
  const camera = { rotation: [1, 0, 0, 0, 1, 0, 0, 0, 1], translation: [0.03, 0, 1] };
  const right = { ...camera, translation: [-0.03, 0, 1] };
  const shared = sharedCamera([camera, right]);
  close(toCamera(shared, [1, 2, 3]).slice(2), [4]);
  const turned = { rotation: [c, 0, -s, 0, 1, 0, s, 0, c], translation: [0, 0, 1] };
  const depths = [camera, turned].map((one) => toCamera(one, [1, 2, 3])[2]);
  close(toCamera(sharedCamera([camera, turned]), [1, 2, 3]).slice(2), [(depths[0] + depths[1]) / 2]);
});

test("products are those of matrices", () => {
  const point = [1, 2, 3];
  close(apply(product(TURNED, TURNED), point), apply(TURNED, apply(TURNED, point)));
});

// Looks along x of the scene, whose z axis points up, tilted down by 30 degrees.
const TILT = Math.PI / 6;
const START = {
  rotation: [0, -1, 0, -Math.sin(TILT), 0, -Math.cos(TILT), Math.cos(TILT), 0, -Math.sin(TILT)],
  width: 640, height: 480, fx: 500, fy: 500, cx: 320, cy: 240, near: 0.1,
};
START.translation = toCamera({ ...START, translation: [0, 0, 0] }, [-4, -1, -3]); // from (4, 1, 3)
const INFO = {
  boundsMin: [5, -2, 0], boundsMax: [9, 2, 4], up: [0, 0, 1], floor: null, metresPerUnit: null,
  startCamera: START,
};

test("a scene stands upright in front of the viewer", () => {
  const room = roomFromScene({ ...INFO, metresPerUnit: 0.5 }, { isOnFloor: true });
  close(apply(room, [4, 1, 3]), [0, 1.6, 0, 1]); // the start camera: eyes of a viewer
  close(apply(room, [6, 1, 3]), [0, 1.6, -1, 1]); // ahead, 2 units
  close(apply(room, [4, 1, 5]), [0, 2.6, 0, 1]); // up
  close(apply(room, [4, -1, 3]), [1, 1.6, 0, 1]); // to the right
});

test("its floor is that of the room", () => {
  const info = { ...INFO, floor: [100, 100, -1], metresPerUnit: 0.5 };
  close(apply(roomFromScene(info, { isOnFloor: true }), [4, 1, -1]), [0, 0, 0, 1]);
  close(apply(roomFromScene(info, { isOnFloor: false }), [4, 1, 3]), [0, 0, 0, 1]);
});

test("a caller states the scale, and an unknown one shows the centre 2 m ahead", () => {
  const given = roomFromScene({ ...INFO, metresPerUnit: 0.5 }, { isOnFloor: true, metresPerUnit: 3 });
  close(apply(given, [5, 1, 3]), [0, 1.6, -3, 1]);
  const unknown = roomFromScene(INFO, { isOnFloor: true });
  const depth = toCamera(START, [7, 0, 2])[2];
  close(apply(unknown, [5, 1, 3]), [0, 1.6, -2 / depth, 1]);
});

test("a scene without up and camera stands as its images do", () => {
  const info = { ...INFO, up: null, startCamera: null };
  const room = roomFromScene(info, { isOnFloor: true });
  const down = apply(room, [0, 1, 0]).map((value, k) => value - apply(room, [0, 0, 0])[k]);
  assert.ok(down[1] < 0 && Math.abs(down[0]) < 1e-9 && Math.abs(down[2]) < 1e-9);
});

test("a camera that looks straight down has its upper edge ahead", () => {
  const rotation = [0, -1, 0, -1, 0, 0, 0, 0, -1];
  const info = { ...INFO, metresPerUnit: 1, startCamera: { ...START, rotation, translation: [0, 0, 5] } };
  const room = roomFromScene(info, { isOnFloor: true });
  close(apply(room, [1, 0, 5]), [0, 1.6, -1, 1]);
});
