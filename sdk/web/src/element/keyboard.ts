// SPDX-License-Identifier: Apache-2.0
// The keys of the player.

export type KeyAction =
  | { type: "toggle" }
  | { type: "seekBy"; direction: 1 | -1 } | { type: "stepBy"; direction: 1 | -1 }
  | { type: "seekToStart" } | { type: "seekToEnd" } | { type: "rateBy"; direction: 1 | -1 }
  | { type: "loop" } | { type: "mute" } | { type: "fullscreen" } | { type: "statistics" };

export type CameraAction =
  | { type: "rotate"; right: number; up: number } | { type: "zoom"; factor: number }
  | { type: "reset" };

export interface KeyInput {
  key: string;
  shiftKey: boolean;
  ctrlKey: boolean;
  altKey: boolean;
  metaKey: boolean;
}

const PLAYBACK: Readonly<Record<string, KeyAction>> = {
  " ": { type: "toggle" },
  k: { type: "toggle" },
  ArrowLeft: { type: "seekBy", direction: -1 },
  ArrowRight: { type: "seekBy", direction: 1 },
  ",": { type: "stepBy", direction: -1 },
  ".": { type: "stepBy", direction: 1 },
  ArrowUp: { type: "rateBy", direction: 1 },
  ArrowDown: { type: "rateBy", direction: -1 },
  Home: { type: "seekToStart" },
  End: { type: "seekToEnd" },
  l: { type: "loop" },
  m: { type: "mute" },
  f: { type: "fullscreen" },
  i: { type: "statistics" },
};

const ROTATION = 0.09; // radians per key press
const ZOOM = 0.9; // factor of the distance per key press
const CAMERA: Readonly<Record<string, CameraAction>> = {
  "Shift+ArrowLeft": { type: "rotate", right: ROTATION, up: 0 },
  "Shift+ArrowRight": { type: "rotate", right: -ROTATION, up: 0 },
  "Shift+ArrowUp": { type: "rotate", right: 0, up: -ROTATION },
  "Shift+ArrowDown": { type: "rotate", right: 0, up: ROTATION },
  "+": { type: "zoom", factor: ZOOM },
  "=": { type: "zoom", factor: ZOOM },
  "-": { type: "zoom", factor: 1 / ZOOM },
  r: { type: "reset" },
};

function nameOf({ key, shiftKey }: KeyInput): string {
  const name = key.length === 1 ? key.toLowerCase() : key;
  return shiftKey && name.startsWith("Arrow") ? `Shift+${name}` : name;
}

/** Returns the action of a key of playback; null: none. */
export function playbackKey(input: KeyInput): KeyAction | null {
  if (input.ctrlKey || input.altKey || input.metaKey) return null;
  return PLAYBACK[nameOf(input)] ?? null;
}

/** Returns the action of a key of the camera; null: none. */
export function cameraKey(input: KeyInput): CameraAction | null {
  if (input.ctrlKey || input.altKey || input.metaKey) return null;
  return CAMERA[nameOf(input)] ?? null;
}

/** Rates of the speed menu. */
export const RATES: readonly number[] = [0.25, 0.5, 0.75, 1, 1.5, 2];

/** Returns the next rate of the menu above or below `rate`. */
export function nextRate(rate: number, direction: 1 | -1): number {
  const next = direction > 0 ? RATES.find((value) => value > rate)
                             : [...RATES].reverse().find((value) => value < rate);
  return next ?? rate;
}

/** Seconds that an arrow key seeks: a tenth of the clip, at most 5 s. */
export function seekStep(duration: number): number {
  return Math.min(5, duration / 10);
}

/** Steps of the keys of a slider, in `seekStep`. */
const SLIDER: Readonly<Record<string, number>> = {
  ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -4, PageUp: 4, Home: -Infinity, End: Infinity,
};

/** Returns the time to which a key of the focused seek slider seeks, seconds; null: it is no key of a slider. */
export function sliderTime(input: KeyInput, time: number, duration: number): number | null {
  const steps = SLIDER[input.key];
  if (steps === undefined || input.shiftKey || input.ctrlKey || input.altKey || input.metaKey) return null;
  return Math.min(Math.max(time + steps * seekStep(duration), 0), duration);
}
