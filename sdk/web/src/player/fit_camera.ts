// SPDX-License-Identifier: Apache-2.0
// The camera at the start, and cameras for an image of another size.
import { Camera, SceneInfo } from "../types";

const OVERVIEW_DISTANCE = 1.2; // scene diagonals: fits the scene to the height
const OVERVIEW_SIZE = { width: 1280, height: 720 };
const NEAR = 1e-3; // of an overview, scene diagonals
const MIN_DIAGONAL = 1e-6; // scene units, of a scene without extent

/** Length of the diagonal of the bounds, scene units, above 0. */
export function sceneDiagonal(info: SceneInfo): number {
  const [x, y, z] = info.boundsMax.map((max, k) => max - info.boundsMin[k]);
  const diagonal = Math.hypot(x, y, z);
  return diagonal > MIN_DIAGONAL ? diagonal : MIN_DIAGONAL;
}

/** Centre of the bounds, scene units. */
export function sceneCentre(info: SceneInfo): number[] {
  return info.boundsMax.map((max, k) => 0.5 * (max + info.boundsMin[k]));
}

/**
 * Returns the start camera of the scene. A scene without one is seen from the front: along +z, from
 * a distance at which it fits the image.
 */
export function startCameraOf(info: SceneInfo): Camera {
  if (info.startCamera !== null) return info.startCamera;
  const [x, y, z] = sceneCentre(info);
  const { width, height } = OVERVIEW_SIZE;
  const diagonal = sceneDiagonal(info);
  return {
    rotation: [1, 0, 0, 0, 1, 0, 0, 0, 1],
    translation: [-x, -y, OVERVIEW_DISTANCE * diagonal - z],
    fx: height, fy: height, cx: width / 2, cy: height / 2,
    width, height, near: NEAR * diagonal,
  };
}

/**
 * Returns the camera for an image of another size in pixels. The larger side keeps its field of
 * view and pixels keep their aspect ratio, so a portrait image is cropped at its sides.
 */
export function fitCamera(camera: Camera, width: number, height: number): Camera {
  const scale = Math.max(width, height) / Math.max(camera.width, camera.height);
  return {
    ...camera,
    fx: camera.fx * scale,
    fy: camera.fy * scale,
    cx: width / 2 + (camera.cx - camera.width / 2) * scale,
    cy: height / 2 + (camera.cy - camera.height / 2) * scale,
    width,
    height,
  };
}

/** Whether two cameras give the same image. */
export function sameCamera(a: Camera, b: Camera): boolean {
  return (
    a.fx === b.fx && a.fy === b.fy && a.cx === b.cx && a.cy === b.cy &&
    a.width === b.width && a.height === b.height && a.near === b.near &&
    a.rotation.every((value, i) => value === b.rotation[i]) &&
    a.translation.every((value, i) => value === b.translation[i])
  );
}
