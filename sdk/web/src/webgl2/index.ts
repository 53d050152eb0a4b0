// SPDX-License-Identifier: Apache-2.0
export { createWebGl2Renderer } from "./renderer";
export type { WebGl2Options } from "./renderer";
export type { Background } from "./frame";
export type { TargetFormat } from "./target";
