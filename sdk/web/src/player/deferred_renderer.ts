// SPDX-License-Identifier: Apache-2.0
import { copyCamera } from "../camera";
import { LoadMarks } from "../marks";
import type { Camera, PackedSegment, Renderer, RendererStatistics, SceneInfo, ViewRenderer } from "../types";
import { abortError, errorOf } from "./errors";

interface View {
  camera: Camera;
  ticks: number;
}

interface ExactView extends View {
  resolve: () => void;
  reject: (error: unknown) => void;
}

/**
 * A renderer that is created asynchronously: until it is ready, the scene, its segments and the last
 * frame are kept for it. If it cannot be created, or fails, `onError` is called, and the next
 * setScene() creates another one.
 */
export class DeferredRenderer implements Renderer {
  onError: (error: Error) => void = (error) => console.error(error);
  private target: Renderer | null = null;
  failure: Error | null = null;
  private readonly destroyed = new AbortController();
  private info: SceneInfo | null = null;
  private readonly segments = new Map<number, PackedSegment>(); // until the renderer is ready
  private latest: View | null = null;
  private readonly waiting: ExactView[] = [];
  whenReady: Promise<void> = Promise.resolve(); // of the last start
  private readonly marks = new LoadMarks();

  /** Calls `create`, whose renderers belong to this object; destroy() aborts the signal. */
  constructor(private readonly create: (signal: AbortSignal) => Promise<Renderer>) {
    this.start();
  }

  get name(): Renderer["name"] {
    return this.target?.name ?? null;
  }

  get maxPrimitives(): number {
    return this.target?.maxPrimitives ?? Infinity;
  }

  get views(): ViewRenderer | null {
    return this.target?.views ?? null;
  }

  get statistics(): RendererStatistics {
    return this.target?.statistics ?? { primitives: 0, visible: 0, sortMs: 0 };
  }

  setScene(info: SceneInfo): void {
    this.info = info;
    this.segments.clear();
    this.marks.reset();
    if (this.failure !== null) {
      this.failure = null;
      this.target?.destroy();
      this.target = null;
      this.start();
    }
    try {
      this.target?.setScene(info);
    } catch (error) {
      this.fail(error); // so that the next scene has another renderer
      throw error;
    }
  }

  addSegment(segment: PackedSegment): void {
    if (this.target !== null) this.upload(this.target, segment);
    else if (this.failure === null) this.segments.set(segment.id, segment);
  }

  removeSegment(id: number): void {
    this.segments.delete(id);
    this.target?.removeSegment(id);
  }

  render(camera: Camera, ticks: number): void {
    if (this.failure !== null) throw this.failure;
    if (this.target === null) {
      this.latest = { camera: copyCamera(camera), ticks };
      return;
    }
    try {
      this.target.render(camera, ticks);
      if (this.target.statistics.visible > 0) this.marks.mark("drawn");
    } catch (error) {
      this.fail(error); // so that the next scene has another renderer
      throw error;
    }
  }

  renderExactly(camera: Camera, ticks: number): Promise<void> {
    if (this.failure !== null) return Promise.reject(this.failure);
    if (this.target !== null) return this.target.renderExactly(camera, ticks);
    return new Promise((resolve, reject) => {
      this.waiting.push({ camera: copyCamera(camera), ticks, resolve, reject });
    });
  }

  async readPixels(): Promise<Float32Array> {
    return this.target?.readPixels() ?? new Float32Array(0);
  }

  destroy(): void {
    if (this.isDestroyed) return;
    this.destroyed.abort();
    this.target?.destroy();
    this.target = null;
    this.segments.clear();
    for (const { reject } of this.waiting.splice(0)) reject(abortError("the renderer was destroyed"));
  }

  private get isDestroyed(): boolean {
    return this.destroyed.signal.aborted;
  }

  private start(): void {
    this.whenReady = this.create(this.destroyed.signal).then(
      (renderer) => {
        if (this.isDestroyed) renderer.destroy();
        else this.adopt(renderer);
      },
      (error) => this.fail(error),
    );
  }

  private adopt(renderer: Renderer): void {
    this.target = renderer;
    this.marks.mark("renderer");
    renderer.onError = (error) => this.fail(error);
    try {
      if (this.info !== null) renderer.setScene(this.info);
      for (const segment of this.segments.values()) this.upload(renderer, segment);
      if (this.latest !== null) renderer.render(this.latest.camera, this.latest.ticks);
    } catch (error) {
      this.fail(error);
    }
    this.segments.clear();
    this.latest = null;
    for (const { camera, ticks, resolve, reject } of this.waiting.splice(0)) {
      renderer.renderExactly(camera, ticks).then(resolve, reject);
    }
  }

  private upload(renderer: Renderer, segment: PackedSegment): void {
    renderer.addSegment(segment);
    this.marks.mark("uploaded");
  }

  private fail(error: unknown): void {
    if (this.isDestroyed || this.failure !== null) return;
    this.failure = errorOf(error);
    this.segments.clear();
    for (const { reject } of this.waiting.splice(0)) reject(this.failure);
    this.onError(this.failure);
  }
}
