// SPDX-License-Identifier: Apache-2.0
import { groupOf, GrowingBuffer, layoutOf } from "./gpu";
import { sortShader } from "./shaders";
import { BUFFER_USAGE, SHADER_STAGE } from "./webgpu_types";
import type {
  GPUBindGroup, GPUBindGroupLayout, GPUBuffer, GPUComputePassEncoder, GPUComputePipeline, GPUDevice,
} from "./webgpu_types";

/** Keys per workgroup, and of a slot without key; as in sort.wgsl. Other keys are below 2^28. */
const kTile = 2048;
export const kHole = 0xffffffff;
const kDigits = 16;
const kPasses = 7; // of 4 bits
/** Bytes between the settings of two passes in their buffer: the largest alignment of WebGPU. */
const kSettingsStride = 256;
/** Index into the words of `drawn` of the number of keys. */
export const kCountWord = 5;
/** Words of `drawn`. */
export const kDrawnWords = 8;

interface Pipelines {
  /** Settings, keys and values in, keys and values out, counts, drawn. */
  layout: GPUBindGroupLayout;
  count: GPUComputePipeline;
  offsets: GPUComputePipeline;
  scatter: GPUComputePipeline;
}

async function pipelinesOf(device: GPUDevice): Promise<Pipelines> {
  const read = "read-only-storage";
  const write = "storage";
  const layout = layoutOf(
    device, SHADER_STAGE.COMPUTE, ["uniform", read, read, write, write, write, write]);
  const module = device.createShaderModule({ code: sortShader });
  const pipeline = (entryPoint: string) => device.createComputePipelineAsync({
    layout: device.createPipelineLayout({ bindGroupLayouts: [layout] }),
    compute: { module, entryPoint },
  });
  const [count, offsets, scatter] = await Promise.all([
    pipeline("count"), pipeline("offsets"), pipeline("scatter"),
  ]);
  return { layout, count, offsets, scatter };
}

/**
 * Sorts the slots that have a key by it, ascending; slots with equal keys keep their order. All of it
 * happens on the GPU; the number of keys is not known to the caller.
 */
export class RadixSort {
  /**
   * The arguments of drawIndexedIndirect() for the splats (sort.wgsl), and the number of keys as
   * word kCountWord.
   */
  readonly drawn: GPUBuffer;
  private readonly keyBuffers: [GrowingBuffer, GrowingBuffer];
  private readonly valueBuffers: [GrowingBuffer, GrowingBuffer];
  private readonly counts: GrowingBuffer;
  private readonly settings: GPUBuffer;
  private groups: GPUBindGroup[] = []; // of the passes
  private slots = 0; // of the settings
  private stride = 0;

  private constructor(private readonly device: GPUDevice, private readonly pipelines: Pipelines) {
    const { STORAGE, INDIRECT, COPY_SRC, COPY_DST, UNIFORM } = BUFFER_USAGE;
    const growing = (content: string) => new GrowingBuffer(device, STORAGE | COPY_SRC, content);
    this.keyBuffers = [growing("the sort keys"), growing("the sort keys")];
    this.valueBuffers = [growing("the sorted splats"), growing("the sorted splats")];
    this.counts = growing("the counts of the sort");
    this.drawn = device.createBuffer(
      { size: 4 * kDrawnWords, usage: STORAGE | INDIRECT | COPY_SRC });
    this.settings = device.createBuffer(
      { size: kPasses * kSettingsStride, usage: UNIFORM | COPY_DST });
  }

  /** Resolves once the shaders are compiled. */
  static async create(device: GPUDevice): Promise<RadixSort> {
    return new RadixSort(device, await pipelinesOf(device));
  }

  /** The keys of the slots, 4 bytes each, which the caller writes before each sort. */
  get keys(): GPUBuffer {
    return this.keyBuffers[0].buffer;
  }

  /** The sorted slots, 4 bytes each. */
  get order(): GPUBuffer {
    return this.valueBuffers[kPasses % 2 as 0 | 1].buffer;
  }

  /** Makes the buffers hold `slots` > 0. Returns whether `keys` and `order` were replaced. */
  reserve(slots: number): boolean {
    let replaced = false;
    for (const buffer of [...this.keyBuffers, ...this.valueBuffers]) {
      replaced = buffer.reserve(4 * slots) || replaced;
    }
    if (!replaced) return false;
    // For as many slots as the buffers hold.
    this.stride = Math.ceil((1.25 * slots + 64) / kTile);
    this.counts.reserve(4 * kDigits * this.stride);
    this.slots = 0;
    this.groups = Array.from({ length: kPasses }, (_, k) => this.groupOfPass(k));
    return true;
  }

  /** Encodes the sort of the first `slots` slots, at most as many as were reserved. */
  encode(pass: GPUComputePassEncoder, slots: number): void {
    this.writeSettings(slots);
    const tiles = Math.ceil(slots / kTile);
    const { count, offsets, scatter } = this.pipelines;
    for (const group of this.groups) {
      pass.setBindGroup(0, group);
      pass.setPipeline(count);
      pass.dispatchWorkgroups(tiles);
      pass.setPipeline(offsets);
      pass.dispatchWorkgroups(1);
      pass.setPipeline(scatter);
      pass.dispatchWorkgroups(tiles);
    }
  }

  destroy(): void {
    for (const buffer of [...this.keyBuffers, ...this.valueBuffers, this.counts,
                          this.drawn, this.settings]) {
      buffer.destroy();
    }
  }

  private groupOfPass(k: number): GPUBindGroup {
    const [from, to] = k % 2 === 0 ? [0, 1] as const : [1, 0] as const;
    const buffers = [this.keyBuffers[from], this.valueBuffers[from], this.keyBuffers[to],
                     this.valueBuffers[to], this.counts].map(({ buffer }) => ({ buffer }));
    const settings = { buffer: this.settings, offset: k * kSettingsStride, size: 16 };
    return groupOf(this.device, this.pipelines.layout,
      [settings, ...buffers, { buffer: this.drawn }]);
  }

  private writeSettings(slots: number): void {
    if (slots === this.slots) return;
    this.slots = slots;
    const words = new Uint32Array((kPasses * kSettingsStride) / 4);
    for (let k = 0; k < kPasses; ++k) {
      words.set([4 * k, k === 0 ? 1 : 0, slots, this.stride], (k * kSettingsStride) / 4);
    }
    this.device.queue.writeBuffer(this.settings, 0, words);
  }
}
