// SPDX-License-Identifier: Apache-2.0
// Cameras of OpenGL matrices, and of several views.
import type { Camera } from "../types";

/** A matrix of 4 x 4 numbers, column by column, as OpenGL, WebXR and 3D engines store it. */
export type Matrix4 = ArrayLike<number>;

/** Returns the product a b. */
export function product(a: Matrix4, b: Matrix4): number[] {
  const out: number[] = [];
  for (let column = 0; column < 4; ++column) {
    for (let row = 0; row < 4; ++row) {
      let sum = 0;
      for (let k = 0; k < 4; ++k) sum += (a[4 * k + row] as number) * (b[4 * column + k] as number);
      out.push(sum);
    }
  }
  return out;
}

/**
 * Returns the camera of an OpenGL projection, which may be asymmetric, and of the matrix from the
 * scene to the view (x right, y up, z backward), which may scale. `near` is in units of the view.
 * The projection has to be a perspective.
 */
export function cameraOfMatrices(
  projection: Matrix4, viewFromScene: Matrix4, width: number, height: number, near: number,
): Camera {
  const p = (k: number) => projection[k] as number;
  const m = (row: number, column: number) => viewFromScene[4 * column + row] as number;
  // A projection that flips the image has a negative p(5).
  const signs = [1, p(5) < 0 ? 1 : -1, -1];
  return {
    rotation: signs.flatMap((sign, row) => [0, 1, 2].map((column) => sign * m(row, column))),
    translation: signs.map((sign, row) => sign * m(row, 3)),
    fx: (width / 2) * p(0),
    fy: (height / 2) * Math.abs(p(5)),
    cx: (width / 2) * (1 - p(8)),
    cy: (height / 2) * (1 + p(9)),
    width, height, near,
  };
}

/** Sine of the angle up to which axes count as parallel: an order is then as good as exact. */
const kMaxSine = 1e-3;

/** Whether the order of depth of one camera is that of the other, wherever they are. */
export function isParallel(a: Camera, b: Camera): boolean {
  const [p, q] = [a, b].map(({ rotation }) => rotation.slice(6, 9)) as [number[], number[]];
  const difference = Math.hypot(...p.map((value, k) => value - (q[k] as number)));
  return difference <= kMaxSine * Math.hypot(...p);
}

/**
 * Returns a camera whose depth of each point is the mean of its depths in `cameras`, so that one
 * order by depth serves them all. Cameras with parallel axes have exactly this order.
 */
export function sharedCamera(cameras: readonly [Camera, ...Camera[]]): Camera {
  const mean = (value: (camera: Camera) => number) =>
    cameras.reduce((sum, camera) => sum + value(camera), 0) / cameras.length;
  const [first] = cameras;
  const rotation = first.rotation.slice();
  for (const k of [6, 7, 8]) rotation[k] = mean((camera) => camera.rotation[k] as number);
  const translation = first.translation.slice();
  translation[2] = mean((camera) => camera.translation[2] as number);
  return { ...first, rotation, translation };
}
