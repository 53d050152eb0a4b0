// SPDX-License-Identifier: Apache-2.0
// stgs/playcanvas: a scene as a script of PlayCanvas.
export { StgsScript } from "./stgs_script";
export type { EnginePlayer } from "../engine/engine_player";
export type { SegmentPlayerOptions } from "../player/segment_player";
export { setResources } from "../resources";
export type { Resources } from "../resources";
