// SPDX-License-Identifier: Apache-2.0

/** Loads the bundle that lets an embedding page control a player. */
export const loadBridge = () => import("./stgs-bridge.js");
