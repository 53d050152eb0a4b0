// SPDX-License-Identifier: Apache-2.0
import { groupOf } from "./gpu";
import { planOf } from "./pipelines";
import type { OccluderFormat, OutputKind, OutputPlan, OutputStep } from "./pipelines";
import { Target } from "./target";
import type { SplatView, ViewBuffer } from "./view_buffer";
import type {
  GPUBindGroup, GPUBindGroupLayout, GPUCommandEncoder, GPUDevice, GPURenderPassEncoder,
  GPURenderPipeline, GPUTextureFormat, GPUTextureView, GPUTimestampWrites,
} from "./webgpu_types";

/** The kind of the textures that a renderer draws to. */
export interface SplatOutputOptions {
  /**
   * Whether views have a depth. Without the device feature `float32-blendable`, depths are summed as half
   * floats, which is less precise, and clamped to 65504 scene units.
   */
  depth?: boolean;
  /** If set, objects of the application hide the splats behind them; each view must then have `occluders`. */
  occluders?: OccluderFormat;
  /** Samples per pixel of the textures of views and of their occluders, 1 (default) or 4; 4 only without depth. */
  samples?: 1 | 4;
  /**
   * Whether the colours of the textures are linear, with the primaries of sRGB; otherwise (default) they
   * are sRGB-encoded. Splats are blended as sRGB-encoded in both cases.
   */
  isLinear?: boolean;
}

function kindOf(format: GPUTextureFormat, options: SplatOutputOptions): OutputKind {
  const { depth = false, occluders = null, samples = 1, isLinear = false } = options;
  if (samples !== 1 && samples !== 4) throw new RangeError(`${samples} samples (expected 1 or 4)`);
  if (depth && samples !== 1) throw new RangeError("the option depth needs textures with 1 sample per pixel");
  return { format, hasDepth: depth, occluders, samples, isLinear };
}

function viewportOf({ camera, at }: SplatView): readonly [number, number, number, number] {
  return [at?.[0] ?? 0, at?.[1] ?? 0, camera.width, camera.height];
}

/** Draws the splats of views to textures of one kind. SplatRenderer.output() creates it. */
export class SplatOutput {
  private readonly kind: OutputKind;
  private readonly plan: OutputPlan;
  private readonly pipelines = new Map<OutputStep, GPURenderPipeline>();
  private readonly targets: readonly Target[]; // of the views
  private readonly resolveGroups: GPUBindGroup[] = []; // of the views, as the following
  private readonly depthGroups: GPUBindGroup[] = [];

  constructor(
    private readonly device: GPUDevice, splatLayout: GPUBindGroupLayout,
    private readonly views: ViewBuffer, format: GPUTextureFormat, options: SplatOutputOptions,
  ) {
    this.kind = kindOf(format, options);
    this.plan = planOf(device, splatLayout, this.kind);
    const { hasDepth, samples } = this.kind;
    this.targets = Array.from({ length: views.length }, () => new Target(device, hasDepth, samples));
  }

  /** Compiles the pipelines without blocking; those that are missing when they are used block. */
  async compile(): Promise<void> {
    await Promise.all(Object.entries(this.plan.descriptors).map(async ([step, descriptor]) => {
      this.pipelines.set(step as OutputStep, await this.device.createRenderPipelineAsync(descriptor));
    }));
  }

  /** Throws an Error if a view does not match the kind of the textures. */
  check({ depth, occluders, content }: SplatView, isOverlay: boolean): void {
    const { hasDepth, isLinear } = this.kind;
    if (depth !== undefined && !hasDepth) {
      throw new Error("a view has a depth, but the renderer was created without the option depth");
    }
    if ((occluders !== undefined) !== (this.kind.occluders !== null)) {
      throw new Error("either all views or none have occluders, as the renderer was created with them");
    }
    if ((content !== undefined) !== (isLinear && isOverlay)) {
      throw new Error("views have a content if colours are linear and there is no background, and only then");
    }
  }

  /** Resizes the images of view k as needed. */
  prepare({ camera: { width, height } }: SplatView, k: number): void {
    const target = this.targets[k] as Target;
    if (!target.resize(width, height)) return;
    const { resolve } = this.plan.layouts;
    const view = this.views.binding(k);
    this.resolveGroups[k] = groupOf(this.device, resolve, [target.view, view]);
    if (target.depthView === null) return;
    this.depthGroups[k] = groupOf(this.device, resolve, [target.depthView, view]);
  }

  /** Blends the splats of view k, which `raster` draws. */
  encodeSplats(
    encoder: GPUCommandEncoder, { occluders, within }: SplatView, k: number,
    times: { timestampWrites?: GPUTimestampWrites },
    raster: (pass: GPURenderPassEncoder, pipeline: GPURenderPipeline) => void,
  ): void {
    const { view, depthView } = this.targets[k] as Target;
    const hasStencil = this.kind.occluders?.format.endsWith("stencil8") === true;
    const pass = encoder.beginRenderPass({
      colorAttachments: (depthView === null ? [view] : [view, depthView]).map((one) => (
        { view: one, loadOp: "clear", storeOp: "store", clearValue: [0, 0, 0, 0] })),
      ...(occluders === undefined ? {} : {
        depthStencilAttachment: {
          view: occluders.depth, depthReadOnly: true,
          ...(hasStencil ? { stencilReadOnly: true } : {}),
        },
      }),
      ...times,
    });
    if (within !== undefined) pass.setScissorRect(...within);
    raster(pass, this.pipeline("splat"));
    pass.end();
  }

  /** Writes the image of view k, and its depth, to the textures of the view. */
  encodeResolve(encoder: GPUCommandEncoder, view: SplatView, k: number, isOverlay: boolean): void {
    const { to, at, within, depth, content } = view;
    const loadOp = isOverlay || at !== undefined || within !== undefined ? "load" : "clear";
    const pass = encoder.beginRenderPass({ colorAttachments: [{ view: to, loadOp, storeOp: "store" }] });
    pass.setPipeline(this.pipeline(isOverlay ? "overlay" : "resolve"));
    pass.setBindGroup(0, content === undefined
      ? this.resolveGroups[k] as GPUBindGroup
      : this.contentGroup(content, k));
    const [x, y, width, height] = viewportOf(view);
    if (at !== undefined) pass.setViewport(x, y, width, height, 0, 1);
    if (within !== undefined) pass.setScissorRect(x + within[0], y + within[1], within[2], within[3]);
    pass.draw(3);
    pass.end();
    if (depth === undefined || !this.kind.hasDepth) return;
    const depthPass = encoder.beginRenderPass({
      colorAttachments: [{ view: depth, loadOp: "clear", storeOp: "store" }],
    });
    depthPass.setPipeline(this.pipeline("depth"));
    depthPass.setBindGroup(0, this.depthGroups[k] as GPUBindGroup);
    depthPass.draw(3);
    depthPass.end();
  }

  /** Reads the last image of the first view, see SplatRenderer.read(). */
  read(): Promise<Float32Array> {
    return (this.targets[0] as Target).read();
  }

  destroy(): void {
    for (const target of this.targets) target.destroy();
  }

  private contentGroup(content: GPUTextureView, k: number): GPUBindGroup {
    const { view } = this.targets[k] as Target;
    return groupOf(this.device, this.plan.layouts.overlay, [view, this.views.binding(k), content]);
  }

  private pipeline(step: OutputStep): GPURenderPipeline {
    let pipeline = this.pipelines.get(step);
    if (pipeline === undefined) {
      pipeline = this.device.createRenderPipeline(this.plan.descriptors[step]!);
      this.pipelines.set(step, pipeline);
    }
    return pipeline;
  }
}
