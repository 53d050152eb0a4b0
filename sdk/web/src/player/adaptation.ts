// SPDX-License-Identifier: Apache-2.0
// Chooses the amount of a scene that is fetched and drawn on this device.
import type { SceneInfo } from "../types";
import { Device, DeviceClass, deviceOf, deviceSignals } from "./device";
import { FrameGovernor } from "./frame_governor";

/**
 * "auto": the tiers within the device's budget of primitives, with lower resolution and fewer tiers while frames
 * are late. The other values are fixed: "low" is half the resolution (per side) and half the budget, "medium" 3/4
 * of the resolution and the budget, "high" the full resolution and all tiers. `maxPrimitives` replaces the budget
 * in each case, and the limits of the GPU apply.
 */
export type Quality = "auto" | "low" | "medium" | "high";

export const QUALITIES: readonly Quality[] = ["auto", "low", "medium", "high"];
export const DEVICES: readonly DeviceClass[] = ["phone", "headset", "desktop"];

/** The current choices of a player, and their reasons. */
export interface QualityReport {
  quality: Quality;
  device: DeviceClass;
  /** The reason for `device`, and the memory of the device. */
  deviceReason: string;
  /** Maximum bytes of fetched and decoded segments. */
  memoryBudget: number;
  /** Maximum number of primitives at one time, which determines the number of tiers; Infinity: no limit. */
  maxPrimitives: number;
  /** Number of tiers that are fetched and shown, and of all tiers of the scene; 0 if no scene is open. */
  tiers: number;
  tierCount: number;
  /** Scale of width and height while the image changes; still images have the full resolution. */
  resolutionScale: number;
  /** The reason for the tiers and the scale. */
  reason: string;
}

/** Settings of a page, which override those of the device. */
export interface QualitySettings {
  /** Default: auto. */
  quality?: Quality;
  /** Default: detected. */
  device?: DeviceClass;
  /** Bytes for fetched and decoded data, 1 MiB to 2 GiB; default: that of the device. */
  memoryBudget?: number;
  /** Maximum number of primitives at one time; default: set by the quality and the device. */
  maxPrimitives?: number;
}

/** Is called when choices change. */
export interface AdaptationClient {
  /** Limits the primitives of the open scene. */
  limit(maxPrimitives: number): void;
  /** The report has changed. */
  changed(): void;
}

interface Step {
  scale: number;
  tiers: number;
}

const FRAME_RATE = 30, XR_FRAME_RATE = 60; // target, frames per second
const SCALES = [0.75, 0.5];
/** Scale of the resolution, and fraction of the device's budget of primitives. */
const FIXED = { low: [0.5, 0.5], medium: [0.75, 1], high: [1, Infinity] } as const;

/** Returns steps of decreasing load: lower resolution and fewer tiers, alternately. */
function loads(tiers: number, scales: readonly number[]): Step[] {
  const steps: Step[] = [{ scale: 1, tiers }];
  for (let i = 0, scale = 1, left = tiers; i < scales.length || left > 1; ++i) {
    if (i < scales.length) steps.push({ scale: scale = scales[i]!, tiers: left });
    if (left > 1) steps.push({ scale, tiers: left = Math.max(1, Math.floor((2 * left) / 3)) });
  }
  return steps;
}

/** Throws a TypeError unless `value` is undefined or one of the names. */
function check(name: string, value: string | undefined, names: readonly string[]): void {
  if (value !== undefined && !names.includes(value))
    throw new TypeError(`invalid ${name} "${value}" (expected one of ${names.join(", ")})`);
}

/** Makes the choices for one player. */
export class Adaptation {
  private readonly device: Device;
  private governor = new FrameGovernor(FRAME_RATE);
  private setting: Quality;
  private rendererLimit = Infinity; // primitives
  private peaks: readonly number[] = []; // SceneInfo.tierPrimitives
  private steps: Step[] = [{ scale: 1, tiers: 1 }];
  private level = 0;
  private isInXr = false;
  private why = "";

  /**
   * `isFixed`: the resolution cannot be changed, because the application sets it or the layout of the page
   * depends on it. Throws a TypeError if a setting has an invalid value.
   */
  constructor(
    private readonly settings: QualitySettings, private readonly client: AdaptationClient, private isFixed = false,
  ) {
    check("quality", settings.quality, QUALITIES);
    check("device", settings.device, DEVICES);
    this.setting = settings.quality ?? "auto";
    this.device = deviceOf(deviceSignals(), settings.device);
  }

  get quality(): Quality {
    return this.setting;
  }
  set quality(quality: Quality) {
    check("quality", quality, QUALITIES);
    if (quality === this.setting) return;
    this.setting = quality;
    this.restart();
  }

  get memoryBudget(): number {
    return this.settings.memoryBudget ?? this.device.memoryBudget;
  }

  /** Maximum number of primitives at one time while frames are not late. */
  get budget(): number {
    const share = this.setting === "auto" ? 1 : FIXED[this.setting][1];
    const own = this.settings.maxPrimitives ?? share * this.device.maxPrimitives;
    return Math.min(own, this.rendererLimit);
  }

  get maxPrimitives(): number {
    if (this.level === 0) return this.budget;
    return Math.min(this.peaks[this.step.tiers - 1] ?? Infinity, this.budget);
  }

  /** Scale of width and height while the image changes. */
  get scale(): number {
    if (this.isFixed) return 1;
    return this.setting === "auto" ? this.step.scale : FIXED[this.setting][0];
  }

  /** Starts a scene. Sends the limits to the core, because they may have changed since load(). */
  open(info: SceneInfo): void {
    this.peaks = info.tierPrimitives;
    this.restart();
  }

  /** Adopts new values of `SceneInfo.tierPrimitives`, and adjusts the limits to them. */
  setPeaks(peaks: readonly number[]): void {
    const { length } = this.peaks;
    if (peaks.length === length && peaks.every((primitives, i) => primitives === this.peaks[i])) return;
    this.peaks = peaks;
    if (peaks.length !== length || this.level === 0) return this.restart();
    this.client.limit(this.maxPrimitives);
    this.client.changed();
  }

  close(): void {
    this.peaks = [];
    this.pause();
  }

  /** Sets the number of primitives that the renderer can hold at one time. */
  limitRenderer(maxPrimitives: number): void {
    if (maxPrimitives === this.rendererLimit) return;
    this.rendererLimit = maxPrimitives;
    this.restart();
  }

  /** Keeps the resolution, because the size of the canvas on the page depends on it. */
  fixResolution(): void {
    this.isFixed = true;
    this.restart();
  }

  /** Enters or leaves a headset, whose session sets the resolution. */
  setXr(isInXr: boolean): void {
    this.isInXr = isInXr;
    this.governor = new FrameGovernor(isInXr ? XR_FRAME_RATE : FRAME_RATE);
    this.restart();
  }

  /** Counts a frame drawn at `now`, milliseconds. `completed`: number of frames finished so far. */
  frame(now: number, completed: number): void {
    const verdict = this.governor.frame(now, completed, this.level > 0);
    if (verdict === null || this.setting !== "auto") return;
    const level = this.level + (verdict === "lower" ? 1 : -1);
    if (level < 0 || level >= this.steps.length) return;
    const rate = this.governor.framesPerSecond!.toFixed(0);
    const { scale, tiers } = this.step;
    this.level = level;
    const what = this.step.scale !== scale ? "resolution" : "tiers";
    const target = this.isInXr ? XR_FRAME_RATE : FRAME_RATE;
    this.why = verdict === "lower" ? `${rate} of ${target} fps: lowered the ${what}`
                                   : `on time (${rate} fps): raised the ${what}`;
    if (this.step.tiers !== tiers) this.client.limit(this.maxPrimitives);
    this.client.changed();
  }

  /** Stops counting until the next frame. */
  pause(): void {
    this.governor.pause();
  }

  report(): QualityReport {
    const { maxPrimitives, peaks } = this;
    const { kind, reason } = this.device;
    return {
      quality: this.setting, device: kind, deviceReason: reason, memoryBudget: this.memoryBudget,
      maxPrimitives, tiers: Math.min(this.tiersWithin(maxPrimitives), peaks.length), tierCount: peaks.length,
      resolutionScale: this.scale, reason: this.why,
    };
  }

  private get step(): Step {
    return this.steps[this.level]!;
  }

  /** The number of tiers within a number of primitives, at least one, as the core chooses it. */
  private tiersWithin(maxPrimitives: number): number {
    return Math.max(1, this.peaks.filter((primitives) => primitives <= maxPrimitives).length);
  }

  /** Starts again with the full load. */
  private restart(): void {
    this.level = 0;
    this.steps = loads(this.tiersWithin(this.budget), this.isInXr || this.isFixed ? [] : SCALES);
    this.why = this.reasonOfBudget();
    this.pause();
    this.client.limit(this.maxPrimitives);
    this.client.changed();
  }

  private reasonOfBudget(): string {
    const { settings, budget } = this;
    if (this.setting !== "auto") return `quality is ${this.setting}`;
    if (this.tiersWithin(budget) >= this.peaks.length) return "everything is within the budget";
    if (budget === this.rendererLimit) return `the GPU can hold ${budget} primitives`;
    return `${settings.maxPrimitives === undefined ? `the budget of a ${this.device.kind}` : "maxPrimitives"} is ${budget} primitives`;
  }
}
