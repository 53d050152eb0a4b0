// SPDX-License-Identifier: Apache-2.0
export { createWebGpuRenderer } from "./renderer";
export type { WebGpuOptions } from "./renderer";
export { SplatRenderer } from "./splat_renderer";
export type { SplatRendererOptions } from "./splat_renderer";
export type { SplatOutput, SplatOutputOptions } from "./splat_output";
export type { OccluderFormat } from "./pipelines";
export type { SortKind } from "./radix_sort";
export type { Background, Occluders, SplatView } from "./view_buffer";
