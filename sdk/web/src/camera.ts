// SPDX-License-Identifier: Apache-2.0
import type { Camera } from "./types";

/** A copy: callers may change their camera until it is drawn. */
export function copyCamera(camera: Camera): Camera {
  const rotation = camera.rotation.slice();
  const translation = camera.translation.slice();
  return { ...camera, rotation, translation };
}

/** Returns the centre of a camera, scene units. Its `rotation` may be any invertible matrix. */
export function centreOf({ rotation, translation }: Camera): [number, number, number] {
  const [a, b, c, d, e, f, g, h, i] = rotation as [
    number, number, number, number, number, number, number, number, number];
  const [x, y, z] = translation as [number, number, number];
  const cofactors = [e * i - f * h, f * g - d * i, d * h - e * g] as const;
  const scale = -1 / (a * cofactors[0] + b * cofactors[1] + c * cofactors[2]);
  return [
    scale * (cofactors[0] * x + (c * h - b * i) * y + (b * f - c * e) * z),
    scale * (cofactors[1] * x + (a * i - c * g) * y + (c * d - a * f) * z),
    scale * (cofactors[2] * x + (b * g - a * h) * y + (a * e - b * d) * z),
  ];
}

/** Floats of `view` in the shaders. */
export const kViewFloats = 24;

/**
 * Returns `view` of the shaders: the rows of the pose with the translation in w; (fx, fy, cx, cy);
 * (width, height, near plane, kernel of the splats); the centre of the camera.
 */
export function viewUniforms(camera: Camera, kernel: number): Float32Array {
  const view = new Float32Array(kViewFloats);
  const r = camera.rotation;
  const t = camera.translation;
  for (let row = 0; row < 3; ++row) {
    view.set([...r.slice(3 * row, 3 * row + 3), t[row] as number], 4 * row);
  }
  view.set(centreOf(camera), 20);
  view.set([camera.fx, camera.fy, camera.cx, camera.cy], 12);
  view.set([camera.width, camera.height, camera.near, kernel], 16);
  return view;
}
