// SPDX-License-Identifier: Apache-2.0

/** Where playback of a source is. */
export interface Position {
  readonly currentTime: number;
  readonly paused: boolean;
}

/** Continues a source, which is being loaded again, at a position. The error event reports failures. */
export function resume(
  player: { currentTime: number; play(): Promise<void> }, loaded: Promise<void>, { currentTime, paused }: Position,
): void {
  loaded.catch(() => undefined);
  player.currentTime = currentTime;
  if (!paused) player.play().catch(() => undefined);
}
