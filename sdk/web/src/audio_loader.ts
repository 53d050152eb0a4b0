// SPDX-License-Identifier: Apache-2.0

/** Loads the bundle that plays sound. */
export const loadAudio = () => import("./stgs-audio.js");
