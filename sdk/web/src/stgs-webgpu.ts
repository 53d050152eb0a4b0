// SPDX-License-Identifier: Apache-2.0
// The bundle that stgs.js loads to draw with WebGPU.
export * from "./webgpu";
