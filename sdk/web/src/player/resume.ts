// SPDX-License-Identifier: Apache-2.0
import type { LiveState } from "../types";

/** The position and state of playback of a source. */
export interface Position {
  readonly currentTime: number;
  readonly paused: boolean;
  readonly live: LiveState | null;
}

/**
 * Resumes a source that is being reloaded: at the live edge if playback followed it, otherwise at the same
 * time. The error event reports failures.
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
