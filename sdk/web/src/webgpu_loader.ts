// SPDX-License-Identifier: Apache-2.0

/** Loads the bundle that draws with WebGPU. */
export const loadWebGpu = () => import("./stgs-webgpu.js");
