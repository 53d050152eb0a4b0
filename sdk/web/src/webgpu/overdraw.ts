// SPDX-License-Identifier: Apache-2.0
import type { Camera } from "../types";
import { splatLayoutOf } from "./pipelines";
import { splatShader } from "./shaders";
import type { SplatRenderer } from "./splat_renderer";
import { kTargetFormat, Target } from "./target";
import type { GPUDevice } from "./webgpu_types";

/** Means per pixel of an image. */
export interface Overdraw {
  fragments: number;
  /** Fragments whose alpha is not below the threshold. */
  blended: number;
}

const kSum = { srcFactor: "one", dstFactor: "one" } as const;

/**
 * Counts the fragments of the last frame of a renderer, for benchmarks. Half floats hold the counts,
 * so a pixel has at most 2048.
 */
export async function overdrawOf(
  device: GPUDevice, renderer: SplatRenderer, { width, height }: Camera,
): Promise<Overdraw> {
  const module = device.createShaderModule({ code: splatShader });
  const pipeline = await device.createRenderPipelineAsync({
    layout: device.createPipelineLayout({ bindGroupLayouts: [splatLayoutOf(device)] }),
    vertex: { module, entryPoint: "corner" },
    fragment: {
      module, entryPoint: "tally",
      targets: [{ format: kTargetFormat, blend: { color: kSum, alpha: kSum } }],
    },
  });
  const target = new Target(device, false);
  target.resize(width, height);
  const encoder = device.createCommandEncoder();
  const pass = encoder.beginRenderPass({
    colorAttachments: [
      { view: target.view, loadOp: "clear", storeOp: "store", clearValue: [0, 0, 0, 0] },
    ],
  });
  renderer.encodeRaster(pass, pipeline);
  pass.end();
  device.queue.submit([encoder.finish()]);
  const counts = await target.read();
  target.destroy();
  const mean = (channel: number) =>
    counts.reduce((sum, count, k) => (k % 4 === channel ? sum + count : sum), 0) / (width * height);
  return { fragments: mean(0), blended: mean(1) };
}
