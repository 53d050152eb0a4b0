// SPDX-License-Identifier: Apache-2.0
export { createWebGpuRenderer } from "./renderer";
export type { WebGpuOptions } from "./renderer";
export { SplatRenderer } from "./splat_renderer";
export type { Background } from "./splat_renderer";
