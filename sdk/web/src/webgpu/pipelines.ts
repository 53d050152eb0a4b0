// SPDX-License-Identifier: Apache-2.0
import { layoutOf } from "./gpu";
import { projectShader, resolveShader, splatShader } from "./shaders";
import { depthSumsFormat, kMaxHalf, kTargetFormat } from "./target";
import { SHADER_STAGE } from "./webgpu_types";
import type {
  GPUBindGroupLayout, GPUComputePipeline, GPUDepthFormat, GPUDevice, GPURenderPipeline,
  GPUShaderModule, GPUTextureFormat,
} from "./webgpu_types";

/** Splats per instance, as in drawn.wgsl. */
export const kQuads = 64;
/** The format of the depth of a view. */
const kDepthFormat = "r32float";

/** The depth textures of the objects that hide splats. */
export interface OccluderFormat {
  format: GPUDepthFormat;
  /** Whether nearer depths are larger. */
  isReversed?: boolean;
}

/** The outputs of the pipelines. */
export interface Outputs {
  /** The format of the textures to be drawn to. */
  format: GPUTextureFormat;
  /** The maximum number of views per frame. */
  views: number;
  hasDepth: boolean;
  occluders: OccluderFormat | null;
}

/** The pipelines of a frame except those of the sort, and the layouts of their bindings. */
export interface Pipelines {
  /** Bindings 0 of project.wgsl: views, segments, depths, records. */
  frameLayout: GPUBindGroupLayout;
  /** Bindings 1 of project.wgsl: words, groups. */
  batchLayout: GPUBindGroupLayout;
  splatLayout: GPUBindGroupLayout;
  /** Bindings of resolve.wgsl: image, view. */
  resolveLayout: GPUBindGroupLayout;
  project: GPUComputePipeline;
  splat: GPURenderPipeline;
  /** Write the image to the texture: replacing its pixels, or blending over them. */
  resolve: GPURenderPipeline;
  overlay: GPURenderPipeline;
  /** Null without depth. */
  resolveDepth: GPURenderPipeline | null;
}

const kOver = { srcFactor: "one", dstFactor: "one-minus-src-alpha" } as const;
const kBlend = { color: kOver, alpha: kOver };

/** Returns the layout of the bindings of splat.wgsl: view, records, order, drawn, depths. */
export function splatLayoutOf(device: GPUDevice): GPUBindGroupLayout {
  const read = "read-only-storage";
  return layoutOf(device, SHADER_STAGE.VERTEX, ["uniform", read, read, read, read]);
}

function splatPipelineOf(
  device: GPUDevice, layout: GPUBindGroupLayout, { hasDepth, occluders }: Outputs,
): Promise<GPURenderPipeline> {
  const module = device.createShaderModule({ code: splatShader });
  const sums = hasDepth ? depthSumsFormat(device) : null;
  const formats = sums === null ? [kTargetFormat] as const : [kTargetFormat, sums] as const;
  const depthStencil = occluders === null ? {} : {
    depthStencil: {
      format: occluders.format, depthWriteEnabled: false as const,
      depthCompare: occluders.isReversed === true ? "greater-equal" as const : "less-equal" as const,
    },
  };
  return device.createRenderPipelineAsync({
    layout: device.createPipelineLayout({ bindGroupLayouts: [layout] }),
    vertex: { module, entryPoint: "corner" },
    fragment: {
      module, entryPoint: hasDepth ? "blend_depth" : "blend",
      targets: formats.map((format) => ({ format, blend: kBlend })),
      ...(sums === "rg16float" ? { constants: { kMaxDepth: kMaxHalf } } : {}),
    },
    ...depthStencil,
  });
}

function resolvePipelineOf(
  device: GPUDevice, layout: GPUBindGroupLayout, module: GPUShaderModule, entryPoint: string,
  target: { format: GPUTextureFormat; blend?: typeof kBlend },
): Promise<GPURenderPipeline> {
  return device.createRenderPipelineAsync({
    layout: device.createPipelineLayout({ bindGroupLayouts: [layout] }),
    vertex: { module, entryPoint: "corner" },
    fragment: { module, entryPoint, targets: [target] },
  });
}

/** Compiles the pipelines. */
export async function pipelinesOf(device: GPUDevice, outputs: Outputs): Promise<Pipelines> {
  const { COMPUTE, FRAGMENT } = SHADER_STAGE;
  const { format, views, hasDepth } = outputs;
  const read = "read-only-storage";
  const frameLayout = layoutOf(device, COMPUTE, ["uniform", read, "storage", "storage"]);
  const batchLayout = layoutOf(device, COMPUTE, [read, read]);
  const splatLayout = splatLayoutOf(device);
  const resolveLayout = layoutOf(device, FRAGMENT, ["texture", "uniform"]);
  const resolveModule = device.createShaderModule({ code: resolveShader });
  const [project, splat, resolve, overlay, resolveDepth] = await Promise.all([
    device.createComputePipelineAsync({
      layout: device.createPipelineLayout({ bindGroupLayouts: [frameLayout, batchLayout] }),
      compute: {
        module: device.createShaderModule({ code: `const kViews = ${views}u;\n${projectShader}` }),
        entryPoint: "project",
      },
    }),
    splatPipelineOf(device, splatLayout, outputs),
    resolvePipelineOf(device, resolveLayout, resolveModule, "resolve", { format }),
    resolvePipelineOf(device, resolveLayout, resolveModule, "resolve", { format, blend: kBlend }),
    hasDepth
      ? resolvePipelineOf(
        device, resolveLayout, resolveModule, "resolve_depth", { format: kDepthFormat })
      : null,
  ]);
  return {
    frameLayout, batchLayout, splatLayout, resolveLayout, project, splat, resolve, overlay,
    resolveDepth,
  };
}
