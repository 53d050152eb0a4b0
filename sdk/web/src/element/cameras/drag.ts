// SPDX-License-Identifier: Apache-2.0
// Pointers on the canvas: the gestures of mouse and touch.
import { CameraRig } from "./rig";

const TAP_DISTANCE = 6; // CSS pixels that a pointer may move in a tap
const TURN_PER_SIZE = 2.4; // radians of a drag over the larger side of the canvas
const SPEED_TIME = 80; // milliseconds before a release that its speed is measured over

interface Pointer {
  x: number;
  y: number;
}

interface Sample extends Pointer {
  time: number;
}

/** One pointer event. Positions are in CSS pixels, times in milliseconds. */
export interface PointerInput {
  id: number;
  x: number;
  y: number;
  time: number;
  /** Whether a drag of one pointer pans: another button of the mouse, or the shift key. */
  pans: boolean;
}

/**
 * One pointer rotates, or pans if it asks to; two pan, and pinch to zoom. A press without a drag is
 * a tap.
 */
export class DragGestures {
  private readonly pointers = new Map<number, Pointer>();
  private samples: Sample[] = [];
  private travelled = 0;
  private pans = false;

  /** `size` returns the larger side of the canvas, CSS pixels. */
  constructor(private readonly rig: CameraRig, private readonly size: () => number) {}

  /** Whether a pointer is down. */
  get active(): boolean {
    return this.pointers.size > 0;
  }

  down({ id, x, y, time, pans }: PointerInput): void {
    if (!this.active) {
      this.travelled = 0;
      this.pans = pans;
    } else {
      this.travelled = Infinity; // two fingers are no tap
    }
    this.pointers.set(id, { x, y });
    this.samples = [{ x, y, time }];
    this.rig.grab();
  }

  /** Returns whether the camera moved. */
  move({ id, x, y, time }: PointerInput): boolean {
    const pointer = this.pointers.get(id);
    if (pointer === undefined || this.pointers.size > 2) return false;
    const before = this.spread();
    const dx = x - pointer.x, dy = y - pointer.y;
    this.pointers.set(id, { x, y });
    this.travelled += Math.hypot(dx, dy);
    if (this.pointers.size === 2) {
      const after = this.spread();
      this.rig.pan(dx / 2 / this.size(), -dy / 2 / this.size());
      if (before > 0 && after > 0) this.rig.zoom(before / after);
    } else if (this.pans) {
      this.rig.pan(dx / this.size(), -dy / this.size());
    } else {
      this.samples.push({ x, y, time });
      this.rig.rotate(this.radians(dx), this.radians(-dy));
    }
    return true;
  }

  /** Returns whether this ends a tap. */
  up({ id, time }: Pick<PointerInput, "id" | "time">): boolean {
    if (!this.pointers.delete(id)) return false;
    if (this.active) {
      this.samples = [];
      return false;
    }
    const isTap = this.travelled <= TAP_DISTANCE;
    if (!isTap && !this.pans) this.release(time);
    return isTap;
  }

  /** Ends all drags where they are. */
  cancel(): void {
    this.pointers.clear();
    this.samples = [];
  }

  private release(time: number): void {
    const recent = this.samples.filter((sample) => time - sample.time <= SPEED_TIME);
    if (recent.length < 2) return;
    const first = recent[0], last = recent[recent.length - 1];
    const seconds = Math.max(time - first.time, 1) / 1000;
    const right = this.radians(last.x - first.x) / seconds;
    this.rig.release(right, this.radians(first.y - last.y) / seconds);
  }

  private radians(pixels: number): number {
    return (pixels / Math.max(this.size(), 1)) * TURN_PER_SIZE;
  }

  /** Distance between two pointers; 0 if there are not two. */
  private spread(): number {
    if (this.pointers.size !== 2) return 0;
    const [a, b] = [...this.pointers.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  }
}
