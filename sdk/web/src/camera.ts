// SPDX-License-Identifier: Apache-2.0
import type { Camera } from "./types";

/** A copy: callers may change their camera until it is drawn. */
export function copyCamera(camera: Camera): Camera {
  const rotation = camera.rotation.slice();
  const translation = camera.translation.slice();
  return { ...camera, rotation, translation };
}

/** Floats of `view` in the shaders. */
export const kViewFloats = 24;

/**
 * Returns `view` of the shaders: the rows of the pose with the translation in w; (fx, fy, cx, cy);
 * (width, height, near plane, 0); the centre of the camera.
 */
export function viewUniforms(camera: Camera): Float32Array {
  const view = new Float32Array(kViewFloats);
  const r = camera.rotation;
  const t = camera.translation;
  for (let row = 0; row < 3; ++row) {
    view.set([...r.slice(3 * row, 3 * row + 3), t[row] as number], 4 * row);
    // The centre is -R' t.
    view[20 + row] = -[0, 1, 2].reduce(
      (sum, k) => sum + (r[3 * k + row] as number) * (t[k] as number), 0);
  }
  view.set([camera.fx, camera.fy, camera.cx, camera.cy], 12);
  view.set([camera.width, camera.height, camera.near, 0], 16);
  return view;
}
