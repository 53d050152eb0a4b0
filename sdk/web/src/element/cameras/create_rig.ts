// SPDX-License-Identifier: Apache-2.0
import type { SceneInfo } from "../../types";
import { FlyCamera } from "./fly";
import { OrbitCamera } from "./orbit";
import type { CameraRig } from "./rig";

/** Creates the camera of an element for a scene. `free`: removes the limits of the orbit. */
export function createRig(info: SceneInfo, flies: boolean, free: boolean): CameraRig {
  const { matches: reducedMotion } = matchMedia("(prefers-reduced-motion: reduce)");
  return flies ? new FlyCamera(info, { reducedMotion }) : new OrbitCamera(info, { free, reducedMotion });
}
