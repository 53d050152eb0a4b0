// SPDX-License-Identifier: Apache-2.0
// Times and figures as text.
import type { RendererStatistics } from "../types";

const SHORT_CLIP = 20; // seconds; shorter clips are shown with tenths

/** Returns `seconds` as h:mm:ss, m:ss or m:ss.t, in the form that suits a clip of this duration. */
export function formatTime(seconds: number, duration: number): string {
  if (!Number.isFinite(seconds)) return "0:00";
  const tenths = duration > 0 && duration < SHORT_CLIP;
  const total = tenths ? Math.floor(seconds * 10 + 1e-6) / 10 : Math.floor(seconds + 1e-6);
  const hours = Math.floor(total / 3600);
  const minutes = Math.floor((total % 3600) / 60);
  const rest = (total % 60).toFixed(tenths ? 1 : 0).padStart(tenths ? 4 : 2, "0");
  if (hours === 0 && duration < 3600) return `${minutes}:${rest}`;
  return `${hours}:${String(minutes).padStart(2, "0")}:${rest}`;
}

/** Returns a time for screen readers. */
export function speakTime(seconds: number): string {
  const total = Math.round(seconds * 10) / 10;
  const minutes = Math.floor(total / 60);
  const rest = Math.round((total - 60 * minutes) * 10) / 10;
  const plural = (count: number, unit: string) => `${count} ${unit}${count === 1 ? "" : "s"}`;
  const spoken = plural(rest, "second");
  return minutes === 0 ? spoken : `${plural(minutes, "minute")} ${spoken}`;
}

/** Returns a number of bytes with a decimal unit. */
export function formatBytes(bytes: number): string {
  const units = ["B", "kB", "MB", "GB", "TB"];
  let value = bytes, unit = 0;
  while (value >= 999.5 && unit < units.length - 1) {
    value /= 1000;
    ++unit;
  }
  return `${unit === 0 || value >= 99.95 ? value.toFixed(0) : value.toFixed(1)} ${units[unit]}`;
}

export function formatCount(count: number): string {
  return count.toLocaleString("en");
}

/** Returns the name of a renderer; 8-bit blending, which shows bands of colour, is pointed out. */
export function formatRenderer(name: "webgl2" | "webgpu" | null, { targetFormat }: RendererStatistics): string {
  if (name === null) return "–";
  return name === "webgpu" ? "WebGPU" : targetFormat === "rgba8" ? "WebGL2, 8-bit blending" : "WebGL2";
}

export function formatRate(rate: number): string {
  return `${rate}×`.replace("-", "−");
}
