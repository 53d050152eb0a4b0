// SPDX-License-Identifier: Apache-2.0
// The bundle that stgs.js loads to draw with WebGL2.
export * from "./webgl2";
