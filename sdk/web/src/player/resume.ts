// SPDX-License-Identifier: Apache-2.0
import type { LiveState } from "../types";

/** Where playback of a source is. */
export interface Position {
  readonly currentTime: number;
  readonly paused: boolean;
  readonly live: LiveState | null;
}

/**
 * Continues a source, which is being loaded again, at a position: at its live edge if playback followed
 * that. The error event reports failures.
 */
export function resume(
  player: { currentTime: number; play(): Promise<void> }, loaded: Promise<void>, { currentTime, paused, live }: Position,
): void {
  loaded.catch(() => undefined);
  // Playback begins at the live edge or at 0 by itself; a seek would end following.
  const isInitial = live?.following ?? currentTime === 0;
  if (!isInitial) player.currentTime = currentTime;
  if (!paused) player.play().catch(() => undefined);
}
