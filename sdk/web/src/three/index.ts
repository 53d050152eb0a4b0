// SPDX-License-Identifier: Apache-2.0
// stgs/three: a scene as an object of three.js.
export { StgsMesh } from "./stgs_mesh";
export type { StgsMeshOptions } from "./stgs_mesh";
export type { EngineOptions, EnginePlayer } from "../engine/engine_player";
