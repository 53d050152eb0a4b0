// SPDX-License-Identifier: Apache-2.0
// Bundles of the package that stgs.js loads.
declare module "*/stgs-webgl2.js" {
  export const createWebGl2Renderer: typeof import("./webgl2").createWebGl2Renderer;
}
declare module "*/stgs-webgpu.js" {
  export const createWebGpuRenderer: typeof import("./webgpu").createWebGpuRenderer;
}
