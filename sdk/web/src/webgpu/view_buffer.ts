// SPDX-License-Identifier: Apache-2.0
import { viewUniforms } from "../camera";
import type { Camera } from "../types";
import { BUFFER_USAGE } from "./webgpu_types";
import type { GPUBuffer, GPUBufferBinding, GPUDevice, GPUTextureView } from "./webgpu_types";

/** Premultiplied RGBA, sRGB-encoded, also with linear colours of the output. */
export type Background = readonly [number, number, number, number];

/** The depth of the objects of an application, which hide the splats behind them. */
export interface Occluders {
  /** A texture of the size of the camera, with the samples per pixel of the output; only its depth is read. */
  depth: GPUTextureView;
  /**
   * [a, b, c, d], d = 1 if omitted: a point z scene units in front of the camera has the depth
   * a + b / z + c log2(d + z) in the texture, 0 to 1. For a projection with planes at n and f:
   * a = f / (f - n), b = -a n, c = 0.
   */
  mapping: readonly [number, number, number, number?];
}

/** A view of a frame, and the textures that receive it. */
export interface SplatView {
  camera: Camera;
  /** Receives the image. */
  to: GPUTextureView;
  /**
   * The upper left corner of the image in `to`, pixels; other pixels keep their content. Default: the
   * image fills `to`.
   */
  at?: readonly [number, number];
  /**
   * The rectangle of the image that is drawn: x, y, width and height, pixels, within the image. Other
   * pixels of `to` keep their content. Default: the whole image.
   */
  within?: readonly [number, number, number, number];
  /**
   * A copy of `to`, as it is before the splats. Required for linear colours without a background,
   * otherwise not permitted.
   */
  content?: GPUTextureView;
  /**
   * Receives the depth, as the native renderers define it: the mean camera z of the splats, in scene units,
   * with their weights in the colour; 0 where alpha is 0. Without the device feature `float32-blendable`,
   * depths are clamped to 65504. An `r32float` texture of the size of the camera.
   */
  depth?: GPUTextureView;
  /** Required if the renderer was created with `occluders`, otherwise not permitted. */
  occluders?: Occluders;
}

/** Bytes of a view in view.wgsl. */
const kStride = 256;

/** The uniforms of the views of a frame. */
export class ViewBuffer {
  private readonly buffer: GPUBuffer;

  /** `length`: the maximum number of views per frame. */
  constructor(private readonly device: GPUDevice, readonly length: number) {
    const { UNIFORM, COPY_DST } = BUFFER_USAGE;
    this.buffer = device.createBuffer({ size: kStride * length, usage: UNIFORM | COPY_DST });
  }

  /** All views. */
  get all(): GPUBufferBinding {
    return { buffer: this.buffer };
  }

  binding(view: number): GPUBufferBinding {
    return { buffer: this.buffer, offset: kStride * view, size: kStride };
  }

  /** `background`: null blends the image over the content of its texture. `kernel`: of the splats. */
  write(views: readonly SplatView[], background: Background | null, kernel: number): void {
    const floats = new Float32Array((kStride / 4) * views.length);
    const words = new Uint32Array(floats.buffer);
    views.forEach(({ camera, at, occluders }, k) => {
      const first = (kStride / 4) * k;
      floats.set(viewUniforms(camera, kernel), first);
      const [a, b, c, d = 1] = occluders?.mapping ?? [0, 0, 0];
      floats.set([a, b, c, d], first + 24);
      floats.set(background ?? [0, 0, 0, 0], first + 28);
      floats.set(at ?? [0, 0], first + 32);
      words[first + 34] = views.length;
    });
    this.device.queue.writeBuffer(this.buffer, 0, floats);
  }

  destroy(): void {
    this.buffer.destroy();
  }
}
