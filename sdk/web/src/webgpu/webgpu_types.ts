// SPDX-License-Identifier: Apache-2.0
// The part of the WebGPU API that the renderer uses. These are structural types, so that the objects
// of a browser or of another implementation, such as Dawn for node, can be passed.

export interface GPUBuffer {
  mapAsync(mode: number): Promise<unknown>;
  getMappedRange(): ArrayBuffer;
  unmap(): void;
  destroy(): void;
}

export interface GPUTextureView {
  readonly label: string;
}

export interface GPUTexture {
  readonly width: number;
  readonly height: number;
  readonly format: string;
  readonly sampleCount: number;
  /** Without a descriptor, the view has all levels and layers. */
  createView(descriptor?: {
    dimension: "2d"; baseMipLevel: number; mipLevelCount: 1; baseArrayLayer: number; arrayLayerCount: 1;
  }): GPUTextureView;
  destroy(): void;
}

export interface GPUQuerySet {
  destroy(): void;
}

export interface GPUBindGroupLayout {
  readonly label: string;
}
export interface GPUPipelineLayout {
  readonly label: string;
}
export interface GPUBindGroup {
  readonly label: string;
}
export interface GPUShaderModule {
  readonly label: string;
}
export interface GPUComputePipeline {
  readonly label: string;
}
export interface GPURenderPipeline {
  readonly label: string;
}
export interface GPUCommandBuffer {
  readonly label: string;
}

/** A range of a buffer; all of it by default. */
export interface GPUBufferBinding {
  buffer: GPUBuffer;
  offset?: number;
  size?: number;
}

export interface GPUBindGroupEntry {
  binding: number;
  resource: GPUBufferBinding | GPUTextureView;
}

export type GPUBufferBindingType = "uniform" | "storage" | "read-only-storage";

export interface GPUBindGroupLayoutEntry {
  binding: number;
  visibility: number;
  buffer?: { type: GPUBufferBindingType };
  texture?: { sampleType: "unfilterable-float"; multisampled: boolean };
}

export interface GPUTimestampWrites {
  querySet: GPUQuerySet;
  beginningOfPassWriteIndex: number;
  endOfPassWriteIndex: number;
}

export interface GPUComputePassEncoder {
  setPipeline(pipeline: GPUComputePipeline): void;
  setBindGroup(index: number, group: GPUBindGroup): void;
  dispatchWorkgroups(x: number, y?: number): void;
  end(): void;
}

export interface GPURenderPassEncoder {
  setPipeline(pipeline: GPURenderPipeline): void;
  setBindGroup(index: number, group: GPUBindGroup): void;
  setIndexBuffer(buffer: GPUBuffer, format: "uint16"): void;
  draw(vertices: number): void;
  drawIndexedIndirect(buffer: GPUBuffer, offset: number): void;
  setViewport(
    x: number, y: number, width: number, height: number, minDepth: number, maxDepth: number,
  ): void;
  setScissorRect(x: number, y: number, width: number, height: number): void;
  end(): void;
}

export interface GPURenderPassDescriptor {
  colorAttachments: {
    view: GPUTextureView;
    loadOp: "clear" | "load";
    storeOp: "store";
    clearValue?: [number, number, number, number];
  }[];
  depthStencilAttachment?: {
    view: GPUTextureView; depthReadOnly: true; stencilReadOnly?: true;
  };
  timestampWrites?: GPUTimestampWrites;
}

export interface GPUCommandEncoder {
  beginComputePass(descriptor: { timestampWrites?: GPUTimestampWrites }): GPUComputePassEncoder;
  beginRenderPass(descriptor: GPURenderPassDescriptor): GPURenderPassEncoder;
  copyBufferToBuffer(
    from: GPUBuffer, fromOffset: number, to: GPUBuffer, toOffset: number, bytes: number,
  ): void;
  copyTextureToBuffer(
    from: { texture: GPUTexture }, to: { buffer: GPUBuffer; bytesPerRow: number },
    size: [number, number],
  ): void;
  copyTextureToTexture(
    from: { texture: GPUTexture; mipLevel?: number; origin?: [number, number, number] },
    to: { texture: GPUTexture }, size: [number, number],
  ): void;
  resolveQuerySet(
    queries: GPUQuerySet, first: number, count: number, to: GPUBuffer, offset: number,
  ): void;
  finish(): GPUCommandBuffer;
}

export interface GPUQueue {
  submit(commands: GPUCommandBuffer[]): void;
  writeBuffer(
    buffer: GPUBuffer, offset: number, data: ArrayBuffer | ArrayBufferView, dataOffset?: number,
    size?: number,
  ): void;
  onSubmittedWorkDone(): Promise<unknown>;
}

/** The formats of canvases and render targets, of the blended image, and of depths. */
export type GPUTextureFormat =
  "rgba8unorm" | "rgba8unorm-srgb" | "bgra8unorm" | "bgra8unorm-srgb" | "rgb10a2unorm" | "rg11b10ufloat" |
  "rgba16float" | "rgba32float" | "rg16float" | "rg32float" | "r32float";

export type GPUDepthFormat =
  "depth16unorm" | "depth24plus" | "depth24plus-stencil8" | "depth32float" | "depth32float-stencil8";

export interface GPUBlendComponent {
  srcFactor: "one";
  dstFactor: "one" | "one-minus-src-alpha";
}

export interface GPURenderPipelineDescriptor {
  layout: GPUPipelineLayout;
  vertex: { module: GPUShaderModule; entryPoint: string };
  fragment: {
    module: GPUShaderModule;
    entryPoint: string;
    constants?: Record<string, number>;
    targets: {
      format: GPUTextureFormat;
      blend?: { color: GPUBlendComponent; alpha: GPUBlendComponent };
    }[];
  };
  depthStencil?: {
    format: GPUDepthFormat; depthCompare: "less-equal" | "greater-equal"; depthWriteEnabled: false;
  };
  multisample?: { count: number };
}

export interface GPUComputePipelineDescriptor {
  layout: GPUPipelineLayout;
  compute: { module: GPUShaderModule; entryPoint: string };
}

export interface GPULimits {
  readonly maxBufferSize: number;
  readonly maxStorageBufferBindingSize: number;
  readonly maxTextureDimension2D: number;
  /** 0 in compatibility mode; missing in older browsers. */
  readonly maxStorageBuffersInVertexStage?: number;
}

export interface GPUDevice {
  readonly features: { has(name: string): boolean };
  readonly limits: GPULimits;
  /** Missing in older browsers. */
  readonly adapterInfo?: { readonly subgroupMinSize?: number; readonly subgroupMaxSize?: number };
  readonly queue: GPUQueue;
  readonly lost: Promise<{ readonly reason: string | undefined; readonly message: string }>;
  createBuffer(descriptor: { size: number; usage: number }): GPUBuffer;
  createTexture(descriptor: {
    size: [number, number]; format: GPUTextureFormat; usage: number; sampleCount?: number;
  }): GPUTexture;
  createQuerySet(descriptor: { type: "timestamp"; count: number }): GPUQuerySet;
  createBindGroupLayout(descriptor: { entries: GPUBindGroupLayoutEntry[] }): GPUBindGroupLayout;
  createPipelineLayout(descriptor: { bindGroupLayouts: GPUBindGroupLayout[] }): GPUPipelineLayout;
  createBindGroup(descriptor: {
    layout: GPUBindGroupLayout; entries: GPUBindGroupEntry[];
  }): GPUBindGroup;
  createShaderModule(descriptor: { code: string }): GPUShaderModule;
  createComputePipelineAsync(descriptor: GPUComputePipelineDescriptor): Promise<GPUComputePipeline>;
  createRenderPipeline(descriptor: GPURenderPipelineDescriptor): GPURenderPipeline;
  createRenderPipelineAsync(descriptor: GPURenderPipelineDescriptor): Promise<GPURenderPipeline>;
  createCommandEncoder(): GPUCommandEncoder;
  addEventListener(
    type: "uncapturederror", listener: (event: { error: { message: string } }) => void,
  ): void;
  destroy(): void;
}

export interface GPUAdapter {
  readonly features: { has(name: string): boolean };
  readonly limits: GPULimits;
  requestDevice(descriptor: {
    requiredFeatures: string[]; requiredLimits: Record<string, number>;
  }): Promise<GPUDevice>;
}

export interface GPU {
  requestAdapter(options: { powerPreference: "high-performance" }): Promise<GPUAdapter | null>;
  getPreferredCanvasFormat(): GPUTextureFormat;
}

export interface GPUCanvasContext {
  configure(configuration: {
    device: GPUDevice; format: GPUTextureFormat; alphaMode: "premultiplied";
  }): void;
  unconfigure(): void;
  getCurrentTexture(): GPUTexture;
}

// Flags, whose values the specification of WebGPU states.

export const BUFFER_USAGE = {
  MAP_READ: 0x1, COPY_SRC: 0x4, COPY_DST: 0x8, INDEX: 0x10, UNIFORM: 0x40, STORAGE: 0x80,
  INDIRECT: 0x100, QUERY_RESOLVE: 0x200,
};
export const TEXTURE_USAGE = {
  COPY_SRC: 0x1, COPY_DST: 0x2, TEXTURE_BINDING: 0x4, RENDER_ATTACHMENT: 0x10,
};
export const SHADER_STAGE = { VERTEX: 0x1, FRAGMENT: 0x2, COMPUTE: 0x4 };
export const MAP_MODE_READ = 0x1;
