// SPDX-License-Identifier: Apache-2.0
// The cameras, without the DOM.
export { DragGestures } from "./drag";
export { FlyCamera } from "./fly";
export { PadReader } from "./gamepad";
export { FlyKeys } from "./keys";
export { OrbitCamera } from "./orbit";
