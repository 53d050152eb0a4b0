// SPDX-License-Identifier: Apache-2.0
import { layoutOf } from "./gpu";
import { projectShader, resolveShader, splatShader } from "./shaders";
import { kTargetFormat } from "./target";
import { SHADER_STAGE } from "./webgpu_types";
import type {
  GPUBindGroupLayout, GPUComputePipeline, GPUDevice, GPURenderPipeline, GPUTextureFormat,
} from "./webgpu_types";

/** Splats per instance, as in sort.wgsl and splat.wgsl. */
export const kQuads = 64;

/** The pipelines of a frame except those of the sort, and the layouts of their bindings. */
export interface Pipelines {
  /** Bindings 0 of project.wgsl: view, segments, depths, records. */
  frameLayout: GPUBindGroupLayout;
  /** Bindings 1 of project.wgsl: words, groups. */
  batchLayout: GPUBindGroupLayout;
  splatLayout: GPUBindGroupLayout;
  /** Of resolve.wgsl: image, background. */
  resolveLayout: GPUBindGroupLayout;
  project: GPUComputePipeline;
  splat: GPURenderPipeline;
  resolve: GPURenderPipeline;
}

const kOver = { srcFactor: "one", dstFactor: "one-minus-src-alpha" } as const;

/** Returns the layout of the bindings of splat.wgsl: view, records, order, drawn. */
export function splatLayoutOf(device: GPUDevice): GPUBindGroupLayout {
  const read = "read-only-storage";
  return layoutOf(device, SHADER_STAGE.VERTEX, ["uniform", read, read, read]);
}

/** Compiles. `format`: of the textures to be drawn to. */
export async function pipelinesOf(device: GPUDevice, format: GPUTextureFormat): Promise<Pipelines> {
  const { COMPUTE, FRAGMENT } = SHADER_STAGE;
  const read = "read-only-storage";
  const frameLayout = layoutOf(device, COMPUTE, ["uniform", read, "storage", "storage"]);
  const batchLayout = layoutOf(device, COMPUTE, [read, read]);
  const splatLayout = splatLayoutOf(device);
  const resolveLayout = layoutOf(device, FRAGMENT, ["texture", "uniform"]);
  const layout = (...bindGroupLayouts: GPUBindGroupLayout[]) =>
    device.createPipelineLayout({ bindGroupLayouts });
  const splatModule = device.createShaderModule({ code: splatShader });
  const resolveModule = device.createShaderModule({ code: resolveShader });
  const [project, splat, resolve] = await Promise.all([
    device.createComputePipelineAsync({
      layout: layout(frameLayout, batchLayout),
      compute: {
        module: device.createShaderModule({ code: projectShader }), entryPoint: "project",
      },
    }),
    device.createRenderPipelineAsync({
      layout: layout(splatLayout),
      vertex: { module: splatModule, entryPoint: "corner" },
      fragment: {
        module: splatModule, entryPoint: "blend",
        targets: [{ format: kTargetFormat, blend: { color: kOver, alpha: kOver } }],
      },
    }),
    device.createRenderPipelineAsync({
      layout: layout(resolveLayout),
      vertex: { module: resolveModule, entryPoint: "corner" },
      fragment: { module: resolveModule, entryPoint: "resolve", targets: [{ format }] },
    }),
  ]);
  return {
    frameLayout, batchLayout, splatLayout, resolveLayout, project, splat, resolve,
  };
}
