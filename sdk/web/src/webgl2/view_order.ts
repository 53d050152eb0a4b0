// SPDX-License-Identifier: Apache-2.0
import { copyCamera } from "../camera";
import type { Camera } from "../types";
import type { OrderTextures } from "./order_textures";
import type { Order, SortRequest } from "./sorter";

/** A camera and a time. The objects are copies: callers may change theirs. */
export interface View {
  camera: Camera;
  ticks: number;
  until: number; // ticks; the latest time, or the earliest in reverse, at which its order is used
}

/** Successive frames that are more seconds apart are a seek, not playback. */
const kMaxStep = 0.25;
/** Bounds how far the order looks ahead, frames. */
const kMaxLatency = 8;

function requestOf({ camera, ticks, until }: View): SortRequest {
  const [x, y, z] = camera.rotation.slice(6, 9) as [number, number, number];
  const offset = camera.translation[2] as number;
  return { direction: [x, y, z], offset, near: camera.near, ticks, until };
}

function isSameOrder(a: View, b: View): boolean {
  return JSON.stringify(requestOf(a)) === JSON.stringify(requestOf(b));
}

/** Returns a view with copies. */
export function viewOf(camera: Camera, ticks: number, until: number): View {
  return { camera: copyCamera(camera), ticks, until };
}

/** The order by depth of a camera that moves from frame to frame. */
export class ViewOrder {
  /** The newest one that has arrived. */
  order: Order | null = null;
  /** Of the last frame; null: there was none. */
  latest: View | null = null;
  /** On the GPU; null while the context is lost. */
  textures: OrderTextures | null = null;
  private sorted: View | null = null; // of the newest request; null if segments changed since then
  private frames = 0;
  private framesAtRequest = 0;
  private latency = 0; // of the sorter, frames
  private step = 0; // ticks between the last two frames of different times

  /** Begins a frame. */
  follow(camera: Camera, ticks: number, tickSeconds: number): View {
    this.latest = viewOf(camera, ticks, this.predict(ticks, tickSeconds));
    ++this.frames;
    return this.latest;
  }

  /** Whether the newest request was for another order than the last frame needs. */
  get isDue(): boolean {
    const { latest, sorted } = this;
    return latest !== null && (sorted === null || !isSameOrder(latest, sorted));
  }

  /** The segments have changed. */
  expire(): void {
    this.sorted = null;
  }

  /** Returns the request for a view, which is sent. */
  request(view: View): SortRequest {
    this.sorted = view;
    this.framesAtRequest = this.frames;
    return requestOf(view);
  }

  /** The reply to the newest request has arrived. */
  adopt(order: Order): void {
    this.order = order;
    this.latency = Math.min(kMaxLatency, this.frames - this.framesAtRequest);
  }

  /**
   * Returns until when the order for a time is used if playback continues at the rate of the last
   * frames, so that it has the primitives that become active meanwhile. The eyes of a headset are
   * frames of the same time.
   */
  private predict(ticks: number, tickSeconds: number): number {
    if (this.latest !== null && ticks !== this.latest.ticks) this.step = ticks - this.latest.ticks;
    const isPlaying = Math.abs(this.step) * tickSeconds < kMaxStep;
    return isPlaying ? ticks + this.step * (2 * this.latency + 2) : ticks;
  }
}
