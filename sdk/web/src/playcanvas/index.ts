// SPDX-License-Identifier: Apache-2.0
// stgs/playcanvas: a scene as a script of PlayCanvas.
export { StgsScript } from "./stgs_script";
export type { EngineOptions, EnginePlayer } from "../engine/engine_player";
