// SPDX-License-Identifier: Apache-2.0
import type { Matrix4 } from "../webgl2/camera";

/** How the engine draws the current image. */
export interface EngineView {
  /** Column by column; depths are from -1 to 1 with WebGL, and from 0 to 1 with WebGPU. A perspective. */
  projection: Matrix4;
  viewFromWorld: Matrix4;
  worldFromScene: Matrix4;
  /** Distance of the near plane. */
  near: number;
  /** Distance of the far plane if the depth buffer is logarithmic; otherwise null. */
  logarithmicFar: number | null;
  /** Whether nearer depths are larger. */
  isReversed: boolean;
  /** Whether the target has linear colours; otherwise they are sRGB-encoded. */
  isLinear: boolean;
}
