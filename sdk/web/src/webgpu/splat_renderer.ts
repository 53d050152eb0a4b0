// SPDX-License-Identifier: Apache-2.0
import type { Camera, PackedSegment, RendererStatistics, SegmentSink } from "../types";
import { FrameReport } from "./frame_report";
import type { FrameFigures } from "./frame_report";
import { groupOf, GrowingBuffer, maxStorageBytes } from "./gpu";
import { kQuads, pipelinesOf } from "./pipelines";
import type { OccluderFormat, Outputs, Pipelines } from "./pipelines";
import { RadixSort } from "./radix_sort";
import type { SortKind } from "./radix_sort";
import { SplatScene } from "./scene";
import { Target } from "./target";
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

/** Settings of a renderer. */
export interface SplatRendererOptions {
  /** The maximum number of views per frame, 1 (default) to 4. */
  views?: number;
  /**
   * Whether views have a depth. Without the device feature `float32-blendable`, depths are summed as half
   * floats, which is less precise, and clamped to 65504 scene units.
   */
  depth?: boolean;
  /** If set, objects of the application hide the splats behind them; each view must then have `occluders`. */
  occluders?: OccluderFormat;
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

function outputsOf(format: GPUTextureFormat, options: SplatRendererOptions): Outputs {
  const { views = 1, depth = false, occluders = null } = options;
  if (!Number.isInteger(views) || views < 1 || views > kMaxViews) {
    throw new RangeError(`${views} views (expected 1 to ${kMaxViews})`);
  }
  return { format, views, hasDepth: depth, occluders };
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
  private readonly targets: readonly Target[]; // of the views
  private readonly viewBuffer: ViewBuffer;
  private readonly indices: GPUBuffer;
  private readonly records: GrowingBuffer;
  private views = 0; // of the groups
  private frameGroup: GPUBindGroup | null = null; // null: there is nothing to draw
  private batchGroups: GPUBindGroup[] = [];
  private splatGroups: GPUBindGroup[] = []; // of the views, as the following
  private readonly resolveGroups: GPUBindGroup[] = [];
  private readonly depthGroups: GPUBindGroup[] = [];

  private constructor(
    private readonly device: GPUDevice, private readonly outputs: Outputs,
    private readonly pipelines: Pipelines, private readonly sort: RadixSort,
  ) {
    const { COPY_DST, INDEX, STORAGE } = BUFFER_USAGE;
    const { views, hasDepth } = outputs;
    this.scene = new SplatScene(device);
    this.report = new FrameReport(device, views);
    this.targets = Array.from({ length: views }, () => new Target(device, hasDepth));
    this.viewBuffer = new ViewBuffer(device, views);
    const indices = quadIndices();
    this.indices = device.createBuffer({ size: indices.byteLength, usage: INDEX | COPY_DST });
    device.queue.writeBuffer(this.indices, 0, indices);
    this.records = new GrowingBuffer(device, STORAGE, "the splats of a frame");
  }

  /**
   * Resolves once the shaders are compiled. `format`: of the textures to be drawn to. Rejects with a
   * RangeError if the number of views is invalid, or if the device cannot run the sort.
   */
  static async create(
    device: GPUDevice, format: GPUTextureFormat, options: SplatRendererOptions = {},
  ): Promise<SplatRenderer> {
    const outputs = outputsOf(format, options);
    const [pipelines, sort] = await Promise.all([
      pipelinesOf(device, outputs), RadixSort.create(device, options.sort),
    ]);
    return new SplatRenderer(device, outputs, pipelines, sort);
  }

  /** `visible`, `computeMs` and `rasterMs` are those of a recent frame. */
  get statistics(): RendererStatistics {
    const { visible, projectMs, sortMs, rasterMs } = this.figures;
    const times = projectMs === null || sortMs === null || rasterMs === null
      ? {}
      : { computeMs: projectMs + sortMs, rasterMs };
    return { primitives: this.scene.primitives, visible, sortMs: sortMs ?? 0, ...times };
  }

  setScene(): void {
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
   * all views. Throws an Error if there are more views than set at creation, if a view does not match the
   * options of the renderer, if a near plane is below 0, if the size of an image is not in whole pixels
   * above 0, or if an image or the splats of the frame are too large for the device.
   */
  drawViews(views: readonly SplatView[], ticks: number, background: Background | null): void {
    views.forEach((view) => this.check(view));
    if (views.length > this.outputs.views) {
      throw new Error(`${views.length} views, but the renderer was created for ${this.outputs.views}`);
    }
    if (views.length === 0) return;
    this.prepare(views, ticks);
    this.viewBuffer.write(views, background);
    const encoder = this.device.createCommandEncoder();
    if (this.frameGroup !== null) this.encodeProjection(encoder, this.frameGroup);
    views.forEach((view, k) => {
      this.encodeSplats(encoder, view, k);
      this.encodeResolve(encoder, view, k, background === null);
    });
    const submitted = this.frameGroup === null ? null : this.report.encode(
      encoder, this.sort.drawn, views.length, (figures) => this.receive(figures));
    this.device.queue.submit([encoder.finish()]);
    submitted?.();
    if (this.frameGroup === null) this.figures = { ...this.figures, visible: 0 };
  }

  /** Maximum number of primitives of a frame, with the number of views set at creation. */
  get maxPrimitives(): number {
    const records = maxStorageBytes(this.device) / (kRecordBytes * this.outputs.views);
    return Math.floor(kPrimitiveShare * records);
  }

  /** Reads the last image of the first view: premultiplied values as blended, RGBA, row by row from the top. */
  read(): Promise<Float32Array> {
    return (this.targets[0] as Target).read();
  }

  /** Destroys all objects except the device. */
  destroy(): void {
    for (const part of [this.scene, this.report, ...this.targets, this.sort, this.viewBuffer,
                        this.indices, this.records]) {
      part.destroy();
    }
  }

  /** Takes over the figures of an earlier frame. */
  private receive(figures: FrameFigures): void {
    if (this.frameGroup !== null) this.figures = figures;
  }

  private check({ camera, depth, occluders }: SplatView): void {
    const { width, height } = camera;
    if (![width, height].every((size) => Number.isInteger(size) && size > 0)) {
      throw new Error(`an image of ${width}x${height} pixels (expected whole numbers above 0)`);
    }
    if (!(camera.near >= 0)) {
      throw new Error(`the near plane is at ${camera.near} scene units (expected 0 or more)`);
    }
    if (depth !== undefined && !this.outputs.hasDepth) {
      throw new Error("a view has a depth, but the renderer was created without the option depth");
    }
    if ((occluders !== undefined) !== (this.outputs.occluders !== null)) {
      throw new Error("either all views or none have occluders, as the renderer was created with them");
    }
  }

  /** Uploads the tables of a frame, and resizes buffers and bindings as needed. */
  private prepare(views: readonly SplatView[], ticks: number): void {
    views.forEach(({ camera }, k) => this.prepareTarget(camera, k));
    const { device, pipelines, scene, sort } = this;
    // Drop outdated bindings now, so that no later frame uses them if growing a buffer fails.
    if (scene.prepare(ticks) || this.views !== views.length) this.frameGroup = null;
    const { slots } = scene;
    if (slots === 0) return;
    if (this.records.reserve(kRecordBytes * slots * views.length)) this.frameGroup = null;
    if (sort.reserve(slots, views.length)) this.frameGroup = null;
    if (this.frameGroup !== null) return;
    this.views = views.length;
    const records = { buffer: this.records.buffer };
    this.frameGroup = groupOf(device, pipelines.frameLayout,
      [this.viewBuffer.all, scene.segments, { buffer: sort.depths }, records]);
    this.batchGroups = scene.batches.map(
      ({ words, groups }) => groupOf(device, pipelines.batchLayout, [words, groups]));
    const size = kRecordBytes * slots;
    this.splatGroups = views.map((_, k) => groupOf(device, pipelines.splatLayout, [
      this.viewBuffer.binding(k), { ...records, offset: size * k, size }, { buffer: sort.order },
      { buffer: sort.drawn }, sort.depthsOf(k),
    ]));
  }

  private prepareTarget({ width, height }: Camera, k: number): void {
    const target = this.targets[k] as Target;
    if (!target.resize(width, height)) return;
    const { resolveLayout } = this.pipelines;
    const view = this.viewBuffer.binding(k);
    this.resolveGroups[k] = groupOf(this.device, resolveLayout, [target.view, view]);
    if (target.depthView === null) return;
    this.depthGroups[k] = groupOf(this.device, resolveLayout, [target.depthView, view]);
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

  /** Sorts and blends the splats of view k. */
  private encodeSplats(encoder: GPUCommandEncoder, { occluders }: SplatView, k: number): void {
    if (this.frameGroup !== null) {
      const sorting = encoder.beginComputePass(this.report.timesOf(1 + 2 * k));
      this.sort.encode(sorting, k);
      sorting.end();
    }
    const { view, depthView } = this.targets[k] as Target;
    const hasStencil = this.outputs.occluders?.format.endsWith("stencil8") === true;
    const pass = encoder.beginRenderPass({
      colorAttachments: (depthView === null ? [view] : [view, depthView]).map((one) => (
        { view: one, loadOp: "clear", storeOp: "store", clearValue: [0, 0, 0, 0] })),
      ...(occluders === undefined ? {} : {
        depthStencilAttachment: {
          view: occluders.depth, depthReadOnly: true,
          ...(hasStencil ? { stencilReadOnly: true } : {}),
        },
      }),
      ...this.report.timesOf(2 + 2 * k),
    });
    this.encodeRaster(pass, this.pipelines.splat, k);
    pass.end();
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

  private encodeResolve(
    encoder: GPUCommandEncoder, { camera, to, at, depth }: SplatView, k: number, isOverlay: boolean,
  ): void {
    const { resolve, overlay, resolveDepth } = this.pipelines;
    const loadOp = isOverlay || at !== undefined ? "load" : "clear";
    const pass = encoder.beginRenderPass({ colorAttachments: [{ view: to, loadOp, storeOp: "store" }] });
    pass.setPipeline(isOverlay ? overlay : resolve);
    pass.setBindGroup(0, this.resolveGroups[k] as GPUBindGroup);
    if (at !== undefined) pass.setViewport(at[0], at[1], camera.width, camera.height, 0, 1);
    pass.draw(3);
    pass.end();
    if (depth === undefined || resolveDepth === null) return;
    const depthPass = encoder.beginRenderPass({
      colorAttachments: [{ view: depth, loadOp: "clear", storeOp: "store" }],
    });
    depthPass.setPipeline(resolveDepth);
    depthPass.setBindGroup(0, this.depthGroups[k] as GPUBindGroup);
    depthPass.draw(3);
    depthPass.end();
  }
}
