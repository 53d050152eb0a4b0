// SPDX-License-Identifier: Apache-2.0
// Everything known about the open scene and its data.
import { LiveState, PackedSegment, SceneInfo, SegmentSink } from "../types";
import { EventName } from "./event_queue";
import { BufferedRanges } from "./ranges";
import { CoreState } from "./seek";

/** The open scene: its buffered ranges, and the segments that the renderer has. */
export class SceneState {
  /** Seconds. */
  duration: number;
  buffered = new BufferedRanges([]);
  live: LiveState | null = null;
  bytes = 0;
  bytesPerSecond = 0;
  memory = 0;
  layers = 0;
  layerCount = 0;
  private readonly resident = new Map<number, { begin: number; end: number }>();

  constructor(readonly info: SceneInfo, private readonly renderer: SegmentSink) {
    this.duration = info.duration;
    renderer.setScene(info);
  }

  /** Adopts the values of a state. Returns the names of the events that report changes. */
  apply(state: CoreState): EventName[] {
    const buffered = new BufferedRanges(state.buffered), events: EventName[] = [];
    if (state.duration !== this.duration) events.push("durationchange");
    if (state.bytes !== this.bytes || !buffered.equals(this.buffered)) events.push("progress");
    if (state.live?.following !== this.live?.following) events.push("livechange");
    this.duration = state.duration;
    this.live = state.live;
    this.buffered = buffered;
    this.bytes = state.bytes;
    this.bytesPerSecond = state.bytesPerSecond;
    this.memory = state.memory;
    this.layers = state.layers;
    this.layerCount = state.layerCount;
    return events;
  }

  /** Whether the image at the time of `state` covers the scene. */
  hasData(state: CoreState): boolean {
    if (state.state === "buffering") return false;
    if (state.state !== "paused") return true;
    return this.buffered.covers(state.seconds, this.info.tickSeconds);
  }

  /** Whether playback can continue at the other end of the clip without fetching. */
  canWrap(): boolean {
    if (this.live !== null) return false;
    const tick = this.info.tickSeconds;
    return this.buffered.covers(0, tick) && this.buffered.covers(this.duration, tick);
  }

  /** Passes a segment to the renderer. Returns whether it is visible at `seconds`. */
  add(segment: PackedSegment, seconds: number): boolean {
    const { id, begin, end } = segment;
    const wasVisible = this.isVisible(id, seconds);
    this.resident.set(id, { begin, end });
    this.renderer.addSegment(segment);
    return wasVisible || this.isVisible(id, seconds);
  }

  /** Removes a segment from the renderer. Returns whether it was visible at `seconds`. */
  remove(id: number, seconds: number): boolean {
    const wasVisible = this.isVisible(id, seconds);
    if (this.resident.delete(id)) this.renderer.removeSegment(id);
    return wasVisible;
  }

  /** Removes all segments from the renderer. */
  clear(): void {
    for (const id of this.resident.keys()) this.renderer.removeSegment(id);
    this.resident.clear();
  }

  /** Whether any segment is visible at `seconds`. */
  isActive(seconds: number): boolean {
    return [...this.resident.keys()].some((id) => this.isVisible(id, seconds));
  }

  private isVisible(id: number, seconds: number): boolean {
    const range = this.resident.get(id);
    const ticks = seconds / this.info.tickSeconds;
    return range !== undefined && ticks >= range.begin - 1 && ticks <= range.end + 1;
  }
}
