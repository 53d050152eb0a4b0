// SPDX-License-Identifier: Apache-2.0
import { layoutOf } from "./gpu";
import { projectShader, resolveShader, splatShader } from "./shaders";
import { depthSumsFormat, kMaxHalf, kTargetFormat } from "./target";
import { SHADER_STAGE } from "./webgpu_types";
import type {
  GPUBindGroupLayout, GPUComputePipeline, GPUDepthFormat, GPUDevice, GPURenderPipelineDescriptor,
  GPUTextureFormat,
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

/** The textures of an output. */
export interface OutputKind {
  /** The format of the textures to be drawn to. */
  format: GPUTextureFormat;
  hasDepth: boolean;
  occluders: OccluderFormat | null;
  /** Per pixel of the textures to be drawn to, and of the occluders. */
  samples: 1 | 4;
  /** Whether the textures to be drawn to have linear colours. */
  isLinear: boolean;
}

/** The part of the pipelines that does not depend on the outputs, except those of the sort. */
export interface Pipelines {
  /** Bindings 0 of project.wgsl: views, segments, depths, records. */
  frameLayout: GPUBindGroupLayout;
  /** Bindings 1 of project.wgsl: words, groups. */
  batchLayout: GPUBindGroupLayout;
  splatLayout: GPUBindGroupLayout;
  project: GPUComputePipeline;
}

/**
 * The pipelines of an output: `splat` blends splats; `resolve` and `overlay` write the image to the
 * texture, replacing its pixels or blending over them; `depth` writes the depth.
 */
export type OutputStep = "splat" | "resolve" | "overlay" | "depth";

/** What an output needs to compile and to bind its pipelines. */
export interface OutputPlan {
  /** Bindings of resolve.wgsl: image, view; and content, if `overlay` reads it. */
  layouts: Record<"resolve" | "overlay", GPUBindGroupLayout>;
  descriptors: Partial<Record<OutputStep, GPURenderPipelineDescriptor>>;
}

const kOver = { srcFactor: "one", dstFactor: "one-minus-src-alpha" } as const;
const kBlend = { color: kOver, alpha: kOver };

/** Returns the layout of the bindings of splat.wgsl: view, records, order, drawn, depths. */
export function splatLayoutOf(device: GPUDevice): GPUBindGroupLayout {
  const read = "read-only-storage";
  return layoutOf(device, SHADER_STAGE.VERTEX, ["uniform", read, read, read, read]);
}

function splatDescriptor(
  device: GPUDevice, layout: GPUBindGroupLayout, { hasDepth, occluders, samples }: OutputKind,
): GPURenderPipelineDescriptor {
  const module = device.createShaderModule({ code: splatShader });
  const sums = hasDepth ? depthSumsFormat(device) : null;
  const formats = sums === null ? [kTargetFormat] as const : [kTargetFormat, sums] as const;
  const depthStencil = occluders === null ? {} : {
    depthStencil: {
      format: occluders.format, depthWriteEnabled: false as const,
      depthCompare: occluders.isReversed === true ? "greater-equal" as const : "less-equal" as const,
    },
  };
  return {
    layout: device.createPipelineLayout({ bindGroupLayouts: [layout] }),
    vertex: { module, entryPoint: "corner" },
    fragment: {
      module, entryPoint: hasDepth ? "blend_depth" : "blend",
      targets: formats.map((format) => ({ format, blend: kBlend })),
      ...(sums === "rg16float" ? { constants: { kMaxDepth: kMaxHalf } } : {}),
    },
    ...depthStencil,
    multisample: { count: samples },
  };
}

/** Creates the layouts and shaders of an output, whose pipelines can then be compiled. */
export function planOf(
  device: GPUDevice, splatLayout: GPUBindGroupLayout, kind: OutputKind,
): OutputPlan {
  const { format, samples, isLinear, hasDepth } = kind;
  const texture = samples === 1 ? "texture" : "multisampled texture";
  const image = samples === 1 ? "texture_2d<f32>" : "texture_multisampled_2d<f32>";
  const module = device.createShaderModule({ code: `alias Image = ${image};\n${resolveShader}` });
  const simple = layoutOf(device, SHADER_STAGE.FRAGMENT, [texture, "uniform"]);
  const overlay = isLinear
    ? layoutOf(device, SHADER_STAGE.FRAGMENT, [texture, "uniform", texture])
    : simple;
  const describe = (
    layout: GPUBindGroupLayout, entryPoint: string, target: { format: GPUTextureFormat; blend?: typeof kBlend },
  ): GPURenderPipelineDescriptor => ({
    layout: device.createPipelineLayout({ bindGroupLayouts: [layout] }),
    vertex: { module, entryPoint: "corner" },
    fragment: { module, entryPoint, targets: [target] },
    multisample: { count: samples },
  });
  return {
    layouts: { resolve: simple, overlay },
    descriptors: {
      splat: splatDescriptor(device, splatLayout, kind),
      resolve: describe(simple, isLinear ? "resolve_linear" : "resolve", { format }),
      overlay: isLinear
        ? describe(overlay, "overlay_linear", { format })
        : describe(overlay, "overlay", { format, blend: kBlend }),
      ...(hasDepth ? { depth: describe(simple, "resolve_depth", { format: kDepthFormat }) } : {}),
    },
  };
}

/** Compiles the pipelines that all outputs share. `views`: the maximum number per frame. */
export async function pipelinesOf(
  device: GPUDevice, splatLayout: GPUBindGroupLayout, views: number,
): Promise<Pipelines> {
  const { COMPUTE } = SHADER_STAGE;
  const read = "read-only-storage";
  const frameLayout = layoutOf(device, COMPUTE, ["uniform", read, "storage", "storage"]);
  const batchLayout = layoutOf(device, COMPUTE, [read, read]);
  const project = await device.createComputePipelineAsync({
    layout: device.createPipelineLayout({ bindGroupLayouts: [frameLayout, batchLayout] }),
    compute: {
      module: device.createShaderModule({ code: `const kViews = ${views}u;\n${projectShader}` }),
      entryPoint: "project",
    },
  });
  return { frameLayout, batchLayout, splatLayout, project };
}
