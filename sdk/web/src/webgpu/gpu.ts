// SPDX-License-Identifier: Apache-2.0
import { BUFFER_USAGE } from "./webgpu_types";
import type {
  GPUBindGroup, GPUBindGroupLayout, GPUBindGroupLayoutEntry, GPUBuffer, GPUBufferBinding,
  GPUBufferBindingType, GPUDevice, GPUTextureView,
} from "./webgpu_types";

/** The resource of a binding; null if the shader does not use the binding number. */
export type Binding = GPUBufferBindingType | "texture" | "multisampled texture" | null;

/** Returns the layout of bindings 0, 1, ... for stages of SHADER_STAGE. */
export function layoutOf(
  device: GPUDevice, visibility: number, bindings: readonly Binding[],
): GPUBindGroupLayout {
  const entries = bindings.flatMap((type, binding): GPUBindGroupLayoutEntry[] => {
    if (type === null) return [];
    const entry = { binding, visibility };
    if (type === "texture" || type === "multisampled texture") {
      const multisampled = type === "multisampled texture";
      return [{ ...entry, texture: { sampleType: "unfilterable-float", multisampled } }];
    }
    return [{ ...entry, buffer: { type } }];
  });
  return device.createBindGroupLayout({ entries });
}

/** Returns a group with the resources of bindings 0, 1, ... */
export function groupOf(
  device: GPUDevice, layout: GPUBindGroupLayout,
  resources: readonly (GPUBufferBinding | GPUTextureView | null)[],
): GPUBindGroup {
  const entries = resources.flatMap(
    (resource, binding) => (resource === null ? [] : [{ binding, resource }]));
  return device.createBindGroup({ layout, entries });
}

/** Returns the largest buffer that a shader can use as a whole, bytes. */
export function maxStorageBytes(device: GPUDevice): number {
  return Math.min(device.limits.maxStorageBufferBindingSize, device.limits.maxBufferSize);
}

/** A buffer that is replaced by a larger one when it is too small; the contents are lost then. */
export class GrowingBuffer {
  private current: GPUBuffer | null = null;
  private bytes = 0;

  /** `content` names it in errors. */
  constructor(
    private readonly device: GPUDevice, private readonly usage: number,
    private readonly content: string,
  ) {}

  /** Only after reserve(). */
  get buffer(): GPUBuffer {
    return this.current as GPUBuffer;
  }

  /**
   * Makes it hold at least `bytes` > 0. Returns whether it was replaced. Throws an Error if no
   * buffer can be as large.
   */
  reserve(bytes: number): boolean {
    if (bytes <= this.bytes) return false;
    const limit = maxStorageBytes(this.device);
    if (bytes > limit) {
      throw new Error(
        `${this.content} need ${bytes} bytes, but buffers of this GPU have at most ${limit}; ` +
        `choose the WebGL2 renderer, or lower the memory budget`);
    }
    const size = Math.min(limit, Math.ceil((1.25 * bytes) / 256) * 256);
    this.current?.destroy();
    this.current = this.device.createBuffer({ size, usage: this.usage | BUFFER_USAGE.COPY_DST });
    this.bytes = size;
    return true;
  }

  destroy(): void {
    this.current?.destroy();
  }
}
