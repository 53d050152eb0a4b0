// SPDX-License-Identifier: Apache-2.0
import { kViewFloats, viewUniforms } from "../camera";
import type { Camera } from "../types";
import { FrameReport } from "./frame_report";
import type { FrameFigures } from "./frame_report";
import { groupOf, GrowingBuffer } from "./gpu";
import { kQuads, pipelinesOf } from "./pipelines";
import type { Pipelines } from "./pipelines";
import { RadixSort } from "./radix_sort";
import type { SortKind } from "./radix_sort";
import { SplatScene } from "./scene";
import { Target } from "./target";
import { BUFFER_USAGE } from "./webgpu_types";
import type {
  GPUBindGroup, GPUBuffer, GPUCommandEncoder, GPUDevice, GPURenderPassEncoder, GPURenderPipeline,
  GPUTextureFormat, GPUTextureView,
} from "./webgpu_types";

const kRecordBytes = 32;

/** Premultiplied RGBA, sRGB-encoded. */
export type Background = readonly [number, number, number, number];

/** Two triangles per rectangle of four vertices. */
function quadIndices(): Uint16Array {
  return Uint16Array.from(
    { length: 6 * kQuads }, (_, k) => 4 * Math.floor(k / 6) + [0, 1, 2, 2, 1, 3][k % 6]!);
}

/**
 * Draws segments to texture views of a device that belongs to the caller. It needs no canvas. The
 * device reports errors of the GPU, such as too little memory, as "uncapturederror".
 */
export class SplatRenderer {
  readonly scene: SplatScene;
  /** Of a recent frame. */
  figures: FrameFigures = { visible: 0, projectMs: null, sortMs: null, rasterMs: null };
  private readonly report: FrameReport;
  private readonly target: Target;
  private readonly view: GPUBuffer;
  private readonly background: GPUBuffer;
  private readonly indices: GPUBuffer;
  private readonly records: GrowingBuffer;
  private frameGroup: GPUBindGroup | null = null; // null: there is nothing to draw
  private batchGroups: GPUBindGroup[] = [];
  private splatGroup: GPUBindGroup | null = null;
  private resolveGroup: GPUBindGroup | null = null;

  private constructor(
    private readonly device: GPUDevice, private readonly pipelines: Pipelines,
    private readonly sort: RadixSort,
  ) {
    const { UNIFORM, COPY_DST, INDEX, STORAGE } = BUFFER_USAGE;
    this.scene = new SplatScene(device);
    this.report = new FrameReport(device);
    this.target = new Target(device);
    this.view = device.createBuffer({ size: 4 * kViewFloats, usage: UNIFORM | COPY_DST });
    this.background = device.createBuffer({ size: 16, usage: UNIFORM | COPY_DST });
    const indices = quadIndices();
    this.indices = device.createBuffer({ size: indices.byteLength, usage: INDEX | COPY_DST });
    device.queue.writeBuffer(this.indices, 0, indices);
    this.records = new GrowingBuffer(device, STORAGE, "the splats of a frame");
  }

  /**
   * Resolves once the shaders are compiled. `format`: of the textures to be drawn to; `sort`: default:
   * the fastest of the device.
   */
  static async create(
    device: GPUDevice, format: GPUTextureFormat, sortKind?: SortKind,
  ): Promise<SplatRenderer> {
    const [pipelines, sort] = await Promise.all([
      pipelinesOf(device, format), RadixSort.create(device, sortKind),
    ]);
    return new SplatRenderer(device, pipelines, sort);
  }

  /**
   * Draws the primitives at `ticks` of the timeline over a background to a view of the size of the
   * camera. Throws an Error if the near plane is below 0, or if the image or the splats of the frame
   * are too large for the device.
   */
  draw(camera: Camera, ticks: number, to: GPUTextureView, background: Background): void {
    const { queue } = this.device;
    if (!(camera.near >= 0)) {
      throw new Error(`the near plane is at ${camera.near} scene units (expected 0 or more)`);
    }
    this.prepare(camera, ticks);
    queue.writeBuffer(this.view, 0, viewUniforms(camera));
    queue.writeBuffer(this.background, 0, new Float32Array(background));
    const encoder = this.device.createCommandEncoder();
    this.encodeSplats(encoder);
    this.encodeResolve(encoder, to);
    const submitted = this.frameGroup === null ? null : this.report.encode(
      encoder, this.sort.drawn, (figures) => this.receive(figures));
    queue.submit([encoder.finish()]);
    submitted?.();
    if (this.frameGroup === null) this.figures = { ...this.figures, visible: 0 };
  }

  /** Reads the last image: premultiplied values as blended, RGBA, row by row from the top. */
  read(): Promise<Float32Array> {
    return this.target.read();
  }

  /** Destroys all objects except the device. */
  destroy(): void {
    for (const part of [this.scene, this.report, this.target, this.sort, this.view,
                        this.background, this.indices, this.records]) {
      part.destroy();
    }
  }

  /** Takes over the figures of an earlier frame. */
  private receive(figures: FrameFigures): void {
    if (this.frameGroup !== null) this.figures = figures;
  }

  /** Uploads the tables of a frame, and makes all buffers and bindings fit. */
  private prepare(camera: Camera, ticks: number): void {
    const { device, pipelines, scene, sort } = this;
    if (this.target.resize(camera.width, camera.height)) {
      this.resolveGroup = groupOf(
        device, pipelines.resolveLayout, [this.target.view, { buffer: this.background }]);
    }
    const changed = scene.prepare(ticks);
    if (scene.slots === 0) {
      this.frameGroup = null;
      return;
    }
    const isLarger = this.records.reserve(kRecordBytes * scene.slots);
    const hasNewSort = sort.reserve(scene.slots);
    if (this.frameGroup !== null && !changed && !isLarger && !hasNewSort) return;
    const view = { buffer: this.view };
    const records = { buffer: this.records.buffer };
    this.frameGroup = groupOf(
      device, pipelines.frameLayout, [view, scene.segments, { buffer: sort.depths }, records]);
    this.batchGroups = scene.batches.map(
      ({ words, groups }) => groupOf(device, pipelines.batchLayout, [words, groups]));
    this.splatGroup = groupOf(
      device, pipelines.splatLayout, [view, records, { buffer: sort.order }, { buffer: sort.drawn }]);
  }

  /**
   * Encodes the draw of the splats of the last frame, with a pipeline of the layout `splatLayout`.
   */
  encodeRaster(pass: GPURenderPassEncoder, pipeline: GPURenderPipeline): void {
    if (this.frameGroup === null || this.splatGroup === null) return;
    pass.setPipeline(pipeline);
    pass.setBindGroup(0, this.splatGroup);
    pass.setIndexBuffer(this.indices, "uint16");
    pass.drawIndexedIndirect(this.sort.drawn, 0);
  }

  private encodeSplats(encoder: GPUCommandEncoder): void {
    if (this.frameGroup !== null) {
      this.encodeProjection(encoder, this.frameGroup);
      const sorting = encoder.beginComputePass(this.report.timesOf(1));
      this.sort.encode(sorting, this.scene.slots);
      sorting.end();
    }
    const pass = encoder.beginRenderPass({
      colorAttachments: [
        { view: this.target.view, loadOp: "clear", storeOp: "store", clearValue: [0, 0, 0, 0] },
      ],
      ...this.report.timesOf(2),
    });
    this.encodeRaster(pass, this.pipelines.splat);
    pass.end();
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

  private encodeResolve(encoder: GPUCommandEncoder, to: GPUTextureView): void {
    const pass = encoder.beginRenderPass({
      colorAttachments: [{ view: to, loadOp: "clear", storeOp: "store" }],
    });
    pass.setPipeline(this.pipelines.resolve);
    pass.setBindGroup(0, this.resolveGroup as GPUBindGroup);
    pass.draw(3);
    pass.end();
  }
}
