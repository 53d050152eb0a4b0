// SPDX-License-Identifier: Apache-2.0
// stgs/three: a scene as an object of three.js.
export { StgsMesh } from "./stgs_mesh";
export type { StgsMeshOptions } from "./stgs_mesh";
export type { ThreeGpuRenderer } from "./backend";
export type { EnginePlayer } from "../engine/engine_player";
export type { GpuEnginePlayer } from "../engine/gpu_engine_player";
export type { SegmentPlayerOptions } from "../player/segment_player";
export { setResources } from "../resources";
export type { Resources } from "../resources";
