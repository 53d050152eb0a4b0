// SPDX-License-Identifier: Apache-2.0
import type { PackedSegment, RendererStatistics, SceneInfo, SegmentSink } from "../types";
import type { SplatRenderer } from "../webgpu";

/** Keeps the segments of a scene for a SplatRenderer whose shaders are still being compiled. */
export class DeferredSplats implements SegmentSink {
  private target: SplatRenderer | null = null;
  private readonly segments = new Map<number, PackedSegment>(); // until the renderer is ready
  private info: SceneInfo | null = null;
  private isDestroyed = false;

  /** Calls `onReady` once the renderer, which belongs to this object, can draw; `onError` if it cannot be created. */
  constructor(
    creation: Promise<SplatRenderer>, onReady: (renderer: SplatRenderer) => void,
    onError: (error: unknown) => void,
  ) {
    creation.then((renderer) => {
      if (this.isDestroyed) {
        renderer.destroy();
        return;
      }
      this.target = renderer;
      if (this.info !== null) renderer.setScene(this.info);
      for (const segment of this.segments.values()) renderer.addSegment(segment);
      this.segments.clear();
      onReady(renderer);
    }).catch((error: unknown) => {
      if (!this.isDestroyed) onError(error);
    });
  }

  /** Null until it is ready, and after destroy(). */
  get renderer(): SplatRenderer | null {
    return this.target;
  }

  get statistics(): RendererStatistics {
    return this.target?.statistics ?? { primitives: 0, visible: 0, sortMs: 0 };
  }

  get maxPrimitives(): number {
    return this.target?.maxPrimitives ?? Infinity;
  }

  setScene(info: SceneInfo): void {
    this.info = info;
    this.segments.clear();
    this.target?.setScene(info);
  }

  addSegment(segment: PackedSegment): void {
    if (this.target !== null) this.target.addSegment(segment);
    else this.segments.set(segment.id, segment);
  }

  removeSegment(id: number): void {
    this.segments.delete(id);
    this.target?.removeSegment(id);
  }

  destroy(): void {
    this.isDestroyed = true;
    this.segments.clear();
    this.target?.destroy();
    this.target = null;
  }
}
