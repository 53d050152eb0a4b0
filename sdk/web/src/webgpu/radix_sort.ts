// SPDX-License-Identifier: Apache-2.0
import { groupOf, GrowingBuffer, layoutOf } from "./gpu";
import { sortPortableShader, sortShader, sortSubgroupsShader } from "./shaders";
import { BUFFER_USAGE, SHADER_STAGE } from "./webgpu_types";
import type {
  GPUBindGroup, GPUBindGroupLayout, GPUBuffer, GPUBufferBinding, GPUComputePassEncoder,
  GPUComputePipeline, GPUDevice,
} from "./webgpu_types";

/** Keys per workgroup, and tiles per chunk. */
const kTile = 4096;
const kChunk = 16;
const kDigits = 256;
const kPasses = 3; // of 8 bits
/** Bytes between the settings of two passes in their buffer: the largest alignment of WebGPU. */
const kSettingsStride = 256;
/** Index into the words of `drawn` of the number of keys: kCount of drawn.wgsl. */
export const kCountWord = 5;
/** Words of `drawn`. */
export const kDrawnWords = 8;

/**
 * The shader of scatter(): sort_portable.wgsl, or sort_subgroups.wgsl, which is faster and needs subgroups
 * of one size.
 */
export type SortKind = "portable" | "subgroups";

/**
 * Returns the number of lanes per subgroup of a device; null if shaders cannot use subgroups, or if sizes
 * vary: implementations then guarantee neither full subgroups nor an exact range of sizes.
 */
function subgroupSize(device: GPUDevice): number | null {
  const { subgroupMinSize: min, subgroupMaxSize: max } = device.adapterInfo ?? {};
  return device.features.has("subgroups") && min !== undefined && min === max ? min : null;
}

/** Lanes per workgroup of sort_subgroups.wgsl: 8 subgroups, but at most the 256 lanes that WebGPU guarantees. */
function lanesOf(subgroup: number): number {
  return Math.min(256, 8 * subgroup);
}

/** Returns the fastest sort of a device. */
export function sortKindOf(device: GPUDevice): SortKind {
  return subgroupSize(device) === null ? "portable" : "subgroups";
}

/** Throws a RangeError if the device cannot run the sort. */
function shaderOf(device: GPUDevice, kind: SortKind): string {
  const sizes = `const kTile = ${kTile}u;\nconst kChunk = ${kChunk}u;\n`;
  if (kind === "portable") {
    return `const kLanes = 64u;\n${sizes}${sortShader}${sortPortableShader}`;
  }
  const size = subgroupSize(device);
  if (size === null) {
    throw new RangeError(
      'the sort "subgroups" needs a device with the feature "subgroups" and, by its adapterInfo, subgroups ' +
      'of one size; request the device with this feature, or choose the sort "portable"');
  }
  return `enable subgroups;\nconst kLanes = ${lanesOf(size)}u;\nconst kIsWide = ${size > 32};\n` +
    `${sizes}${sortShader}${sortSubgroupsShader}`;
}

interface Pipelines {
  /** Of sort.wgsl: settings, depths, pairs in, pairs out, counts, drawn. */
  layout: GPUBindGroupLayout;
  findRange: GPUComputePipeline;
  count: GPUComputePipeline;
  sumChunk: GPUComputePipeline;
  scatter: GPUComputePipeline;
}

async function pipelinesOf(device: GPUDevice, kind: SortKind): Promise<Pipelines> {
  const read = "read-only-storage";
  const write = "storage";
  const layout = layoutOf(
    device, SHADER_STAGE.COMPUTE, ["uniform", read, read, write, write, write]);
  const module = device.createShaderModule({ code: shaderOf(device, kind) });
  const pipeline = (entryPoint: string) => device.createComputePipelineAsync({
    layout: device.createPipelineLayout({ bindGroupLayouts: [layout] }),
    compute: { module, entryPoint },
  });
  const [findRange, count, sumChunk, scatter] = await Promise.all([
    pipeline("find_range"), pipeline("count"), pipeline("sum_chunk"), pipeline("scatter"),
  ]);
  return { layout, findRange, count, sumChunk, scatter };
}

/**
 * Sorts the visible slots by ascending depth; slots with equal depths keep their order. Everything
 * happens on the GPU; the caller does not know the number of visible slots.
 */
export class RadixSort {
  /**
   * The arguments of drawIndexedIndirect() for the splats (sort.wgsl), and the number of visible slots
   * as word kCountWord.
   */
  readonly drawn: GPUBuffer;
  private readonly depthBuffer: GrowingBuffer;
  private readonly pairBuffers: [GrowingBuffer, GrowingBuffer];
  private readonly counts: GrowingBuffer;
  private readonly settings: GPUBuffer;
  private groups: GPUBindGroup[][] = []; // of the views and their passes
  private slots = 0;
  private views = 0;

  private constructor(private readonly device: GPUDevice, private readonly pipelines: Pipelines) {
    const { STORAGE, INDIRECT, COPY_SRC, COPY_DST, UNIFORM } = BUFFER_USAGE;
    const growing = (content: string) => new GrowingBuffer(device, STORAGE | COPY_SRC, content);
    this.depthBuffer = growing("the depths of the splats");
    this.pairBuffers = [growing("the sorted splats"), growing("the sorted splats")];
    this.counts = growing("the counts of the sort");
    this.drawn = device.createBuffer(
      { size: 4 * kDrawnWords, usage: STORAGE | INDIRECT | COPY_SRC });
    this.settings = device.createBuffer(
      { size: kPasses * kSettingsStride, usage: UNIFORM | COPY_DST });
  }

  /**
   * Resolves once the shaders are compiled. Rejects with a RangeError if the device cannot run `kind`: see
   * SortKind.
   */
  static async create(device: GPUDevice, kind: SortKind = sortKindOf(device)): Promise<RadixSort> {
    return new RadixSort(device, await pipelinesOf(device, kind));
  }

  /** The depths of the slots, view by view, 4 bytes each. The caller writes them before each sort. */
  get depths(): GPUBuffer {
    return this.depthBuffer.buffer;
  }

  /** The depths of a view. */
  depthsOf(view: number): GPUBufferBinding {
    return { buffer: this.depths, offset: 4 * this.slots * view, size: 4 * this.slots };
  }

  /** The sorted slots of the last sort: pairs of the key and the slot, 4 bytes each. */
  get order(): GPUBuffer {
    return this.pairBuffers[(kPasses - 1) % 2 as 0 | 1].buffer;
  }

  /**
   * Sets the number of slots > 0; with several views, it is a multiple of 64. Returns whether `depths`
   * and `order` were replaced. Throws an Error if a buffer would exceed the limits of the device.
   */
  reserve(slots: number, views = 1): boolean {
    if (slots === this.slots && views === this.views) return false;
    this.slots = 0; // until all buffers are large enough
    const chunks = Math.ceil(slots / (kTile * kChunk));
    this.depthBuffer.reserve(4 * slots * views);
    for (const buffer of this.pairBuffers) buffer.reserve(8 * slots);
    this.counts.reserve(4 * kDigits * (kChunk + 1) * chunks);
    this.slots = slots;
    this.views = views;
    this.writeSettings(kChunk * chunks);
    this.groups = Array.from({ length: views }, (_, view) =>
      Array.from({ length: kPasses }, (__, k) => this.groupOfPass(view, k)));
    return true;
  }

  /** Encodes the sort of a view. */
  encode(pass: GPUComputePassEncoder, view = 0): void {
    const tiles = Math.ceil(this.slots / kTile);
    const { findRange, count, sumChunk, scatter } = this.pipelines;
    const groups = this.groups[view] as GPUBindGroup[];
    pass.setBindGroup(0, groups[0] as GPUBindGroup);
    pass.setPipeline(findRange);
    pass.dispatchWorkgroups(tiles);
    for (const group of groups) {
      pass.setBindGroup(0, group);
      pass.setPipeline(count);
      pass.dispatchWorkgroups(tiles);
      pass.setPipeline(sumChunk);
      pass.dispatchWorkgroups(Math.ceil(tiles / kChunk), kDigits / 64);
      pass.setPipeline(scatter);
      pass.dispatchWorkgroups(tiles);
    }
  }

  destroy(): void {
    for (const buffer of [this.depthBuffer, ...this.pairBuffers, this.counts, this.drawn,
                          this.settings]) {
      buffer.destroy();
    }
  }

  private groupOfPass(view: number, k: number): GPUBindGroup {
    const [to, from] = k % 2 === 0 ? this.pairBuffers : [this.pairBuffers[1], this.pairBuffers[0]];
    const buffers = [from, to, this.counts].map(({ buffer }) => ({ buffer }));
    const settings = { buffer: this.settings, offset: k * kSettingsStride, size: 16 };
    return groupOf(this.device, this.pipelines.layout,
      [settings, this.depthsOf(view), ...buffers, { buffer: this.drawn }]);
  }

  /** `tiles`: number of tiles that `counts` has space for. */
  private writeSettings(tiles: number): void {
    const words = new Uint32Array((kPasses * kSettingsStride) / 4);
    for (let k = 0; k < kPasses; ++k) {
      words.set([8 * k, k === 0 ? 1 : 0, this.slots, tiles], (k * kSettingsStride) / 4);
    }
    this.device.queue.writeBuffer(this.settings, 0, words);
  }
}
