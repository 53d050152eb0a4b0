// SPDX-License-Identifier: Apache-2.0
// Players in frames: a separate bundle with both sides of the bridge.
export { connect, RemotePlayer } from "./bridge/connect";
export type { ConnectOptions } from "./bridge/connect";
export { expose } from "./bridge/expose";
export type { Exposable } from "./bridge/expose";
export type { RemoteState, Settings } from "./bridge/protocol";
export type { CameraView } from "./element/cameras/rig";
