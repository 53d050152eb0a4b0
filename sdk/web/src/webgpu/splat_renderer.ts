// SPDX-License-Identifier: Apache-2.0
import type { Camera, PackedSegment, RendererStatistics, SceneInfo, SegmentSink } from "../types";
import { FrameReport } from "./frame_report";
import type { FrameFigures } from "./frame_report";
import { groupOf, GrowingBuffer, maxStorageBytes } from "./gpu";
import { kQuads, pipelinesOf, splatLayoutOf } from "./pipelines";
import type { Pipelines } from "./pipelines";
import { RadixSort } from "./radix_sort";
import type { SortKind } from "./radix_sort";
import { SplatScene } from "./scene";
import { SplatOutput } from "./splat_output";
import type { SplatOutputOptions } from "./splat_output";
import { ViewBuffer } from "./view_buffer";
import type { Background, SplatView } from "./view_buffer";
import { BUFFER_USAGE } from "./webgpu_types";
import type {
  GPUBindGroup, GPUBuffer, GPUCommandEncoder, GPUDevice, GPURenderPassEncoder, GPURenderPipeline,
  GPUTextureFormat, GPUTextureView,
} from "./webgpu_types";

const kRecordBytes = 32;
const kMaxViews = 4;
/** Fraction of the records of a frame that are primitives; the others are padding of segments. */
const kPrimitiveShare = 15 / 16;

/** Settings of a renderer, and the kind of the textures of its default output. */
export interface SplatRendererOptions extends SplatOutputOptions {
  /** The maximum number of views per frame, 1 (default) to 4. */
  views?: number;
  /**
   * Default: the fastest sort that the device can run. "subgroups" needs the device feature `subgroups`,
   * and subgroups of one size.
   */
  sort?: SortKind;
}

/** Two triangles per rectangle of four vertices. */
function quadIndices(): Uint16Array {
  return Uint16Array.from(
    { length: 6 * kQuads }, (_, k) => 4 * Math.floor(k / 6) + [0, 1, 2, 2, 1, 3][k % 6]!);
}

/** Names the kind of the textures of an output. */
function keyOf(format: GPUTextureFormat, options: SplatOutputOptions): string {
  const { depth = false, occluders, samples = 1, isLinear = false } = options;
  return [format, depth, occluders?.format, occluders?.isReversed === true, samples, isLinear].join();
}

function checkCamera({ width, height, near }: Camera): void {
  if (![width, height].every((size) => Number.isInteger(size) && size > 0)) {
    throw new Error(`an image of ${width}x${height} pixels (expected whole numbers above 0)`);
  }
  if (!(near >= 0)) {
    throw new Error(`the near plane is at ${near} scene units (expected 0 or more)`);
  }
}

/**
 * Draws segments to texture views of a device that belongs to the caller. It needs no canvas. The
 * device reports errors of the GPU, such as too little memory, as "uncapturederror", and its loss;
 * another renderer of another device then needs the segments again.
 */
export class SplatRenderer implements SegmentSink {
  readonly scene: SplatScene;
  /** Of a recent frame. */
  figures: FrameFigures = { visible: 0, projectMs: null, sortMs: null, rasterMs: null };
  private readonly report: FrameReport;
  private readonly outputs = new Map<string, SplatOutput>(); // by the kind of their textures
  private readonly indices: GPUBuffer;
  private readonly records: GrowingBuffer;
  private kernel = 0; // of the splats
  private views = 0; // of the groups
  private frameGroup: GPUBindGroup | null = null; // null: there is nothing to draw
  private batchGroups: GPUBindGroup[] = [];
  private splatGroups: GPUBindGroup[] = []; // of the views

  private constructor(
    private readonly device: GPUDevice, private readonly pipelines: Pipelines,
    private readonly sort: RadixSort, private readonly viewBuffer: ViewBuffer,
    private readonly defaultOutput: SplatOutput,
  ) {
    const { COPY_DST, INDEX, STORAGE } = BUFFER_USAGE;
    this.scene = new SplatScene(device);
    this.report = new FrameReport(device, viewBuffer.length);
    const indices = quadIndices();
    this.indices = device.createBuffer({ size: indices.byteLength, usage: INDEX | COPY_DST });
    device.queue.writeBuffer(this.indices, 0, indices);
    this.records = new GrowingBuffer(device, STORAGE, "the splats of a frame");
  }

  /**
   * Resolves once the shaders are compiled. `format`: of the textures to be drawn to. Rejects with a
   * RangeError if the number of views or of samples is invalid, or if the device cannot run the sort.
   */
  static async create(
    device: GPUDevice, format: GPUTextureFormat, options: SplatRendererOptions = {},
  ): Promise<SplatRenderer> {
    const { views = 1, sort: sortKind, ...output } = options;
    if (!Number.isInteger(views) || views < 1 || views > kMaxViews) {
      throw new RangeError(`${views} views (expected 1 to ${kMaxViews})`);
    }
    const splatLayout = splatLayoutOf(device);
    const viewBuffer = new ViewBuffer(device, views);
    const defaultOutput = new SplatOutput(device, splatLayout, viewBuffer, format, output);
    const [pipelines, sort] = await Promise.all([
      pipelinesOf(device, splatLayout, views), RadixSort.create(device, sortKind), defaultOutput.compile(),
    ]);
    const renderer = new SplatRenderer(device, pipelines, sort, viewBuffer, defaultOutput);
    renderer.outputs.set(keyOf(format, output), defaultOutput);
    return renderer;
  }

  /**
   * Returns the output to textures of another kind than those set at creation, which belongs to this object. Its
   * shaders are compiled when it is first drawn to. Throws a RangeError if the options are invalid.
   */
  output(format: GPUTextureFormat, options: SplatOutputOptions): SplatOutput {
    const key = keyOf(format, options);
    let output = this.outputs.get(key);
    if (output === undefined) {
      const { device, pipelines: { splatLayout }, viewBuffer } = this;
      output = new SplatOutput(device, splatLayout, viewBuffer, format, options);
      this.outputs.set(key, output);
    }
    return output;
  }

  /** `visible`, `computeMs` and `rasterMs` are those of a recent frame. */
  get statistics(): RendererStatistics {
    const { visible, projectMs, sortMs, rasterMs } = this.figures;
    const times = projectMs === null || sortMs === null || rasterMs === null
      ? {}
      : { computeMs: projectMs + sortMs, rasterMs };
    return { primitives: this.scene.primitives, visible, sortMs: sortMs ?? 0, ...times };
  }

  /** Removes all segments. `kernel`: that of the scene's description (`SceneInfo`). */
  setScene({ kernel }: Pick<SceneInfo, "kernel">): void {
    this.kernel = kernel;
    this.scene.clear();
  }

  addSegment(segment: PackedSegment): void {
    this.scene.add(segment);
  }

  removeSegment(id: number): void {
    this.scene.remove(id);
  }

  /**
   * Draws the primitives at `ticks` of the timeline over a background to a texture view of the size of
   * the camera. Throws an Error as drawViews().
   */
  draw(camera: Camera, ticks: number, to: GPUTextureView, background: Background): void {
    this.drawViews([{ camera, to }], ticks, background);
  }

  /**
   * Draws views of the primitives at `ticks` of the timeline, in the order of the views, over a
   * background, or, if it is null, over the content of their textures. Evaluates the primitives once for
   * all views. `output`: of output(); default: to textures of the kind set at creation. Throws an Error if
   * there are more views than set at creation, if a view does not match the output, if a near plane is
   * below 0, if the size of an image is not in whole pixels above 0, or if an image or the splats of the
   * frame are too large for the device.
   */
  drawViews(
    views: readonly SplatView[], ticks: number, background: Background | null,
    output = this.defaultOutput,
  ): void {
    views.forEach((view) => {
      checkCamera(view.camera);
      output.check(view, background === null);
    });
    if (views.length > this.viewBuffer.length) {
      throw new Error(`${views.length} views, but the renderer was created for ${this.viewBuffer.length}`);
    }
    if (views.length === 0) return;
    views.forEach((view, k) => output.prepare(view, k));
    this.prepare(views.length, ticks);
    this.viewBuffer.write(views, background, this.kernel);
    const encoder = this.device.createCommandEncoder();
    if (this.frameGroup !== null) this.encodeProjection(encoder, this.frameGroup);
    views.forEach((view, k) => {
      if (this.frameGroup !== null) this.encodeSort(encoder, k);
      output.encodeSplats(encoder, view, k, this.report.timesOf(2 + 2 * k),
        (pass, pipeline) => this.encodeRaster(pass, pipeline, k));
      output.encodeResolve(encoder, view, k, background === null);
    });
    const submitted = this.frameGroup === null ? null : this.report.encode(
      encoder, this.sort.drawn, views.length, (figures) => this.receive(figures));
    this.device.queue.submit([encoder.finish()]);
    submitted?.();
    if (this.frameGroup === null) this.figures = { ...this.figures, visible: 0 };
  }

  /** Maximum number of primitives of a frame, with the number of views set at creation. */
  get maxPrimitives(): number {
    const records = maxStorageBytes(this.device) / (kRecordBytes * this.viewBuffer.length);
    return Math.floor(kPrimitiveShare * records);
  }

  /**
   * Reads the last image of the first view of the default output: premultiplied values as blended, RGBA, row
   * by row from the top. Rejects if it has 4 samples per pixel.
   */
  read(): Promise<Float32Array> {
    return this.defaultOutput.read();
  }

  /** Destroys all objects except the device. */
  destroy(): void {
    for (const part of [this.scene, this.report, ...this.outputs.values(), this.sort, this.viewBuffer,
                        this.indices, this.records]) {
      part.destroy();
    }
  }

  /** Takes over the figures of an earlier frame. */
  private receive(figures: FrameFigures): void {
    if (this.frameGroup !== null) this.figures = figures;
  }

  /** Uploads the tables of a frame, and resizes buffers and bindings as needed. */
  private prepare(views: number, ticks: number): void {
    const { device, pipelines, scene, sort } = this;
    // Drop outdated bindings now, so that no later frame uses them if growing a buffer fails.
    if (scene.prepare(ticks) || this.views !== views) this.frameGroup = null;
    const { slots } = scene;
    if (slots === 0) return;
    if (this.records.reserve(kRecordBytes * slots * views)) this.frameGroup = null;
    if (sort.reserve(slots, views)) this.frameGroup = null;
    if (this.frameGroup !== null) return;
    this.views = views;
    const records = { buffer: this.records.buffer };
    this.frameGroup = groupOf(device, pipelines.frameLayout,
      [this.viewBuffer.all, scene.segments, { buffer: sort.depths }, records]);
    this.batchGroups = scene.batches.map(
      ({ words, groups }) => groupOf(device, pipelines.batchLayout, [words, groups]));
    const size = kRecordBytes * slots;
    this.splatGroups = Array.from({ length: views }, (_, k) => groupOf(device, pipelines.splatLayout, [
      this.viewBuffer.binding(k), { ...records, offset: size * k, size }, { buffer: sort.order },
      { buffer: sort.drawn }, sort.depthsOf(k),
    ]));
  }

  private encodeProjection(encoder: GPUCommandEncoder, group: GPUBindGroup): void {
    const pass = encoder.beginComputePass(this.report.timesOf(0));
    pass.setPipeline(this.pipelines.project);
    pass.setBindGroup(0, group);
    this.scene.batches.forEach(({ count }, k) => {
      pass.setBindGroup(1, this.batchGroups[k] as GPUBindGroup);
      // A dimension has at most 65535 workgroups.
      const rows = Math.ceil(count / 65535);
      pass.dispatchWorkgroups(Math.ceil(count / rows), rows);
    });
    pass.end();
  }

  private encodeSort(encoder: GPUCommandEncoder, k: number): void {
    const sorting = encoder.beginComputePass(this.report.timesOf(1 + 2 * k));
    this.sort.encode(sorting, k);
    sorting.end();
  }

  /**
   * Encodes the draw of the splats of view k, which was sorted last, with a pipeline of the layout of
   * splatLayoutOf().
   */
  encodeRaster(pass: GPURenderPassEncoder, pipeline: GPURenderPipeline, k = 0): void {
    if (this.frameGroup === null) return;
    pass.setPipeline(pipeline);
    pass.setBindGroup(0, this.splatGroups[k] as GPUBindGroup);
    pass.setIndexBuffer(this.indices, "uint16");
    pass.drawIndexedIndirect(this.sort.drawn, 0);
  }
}
