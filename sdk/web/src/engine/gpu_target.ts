// SPDX-License-Identifier: Apache-2.0
// Textures of a 3D engine that draws with WebGPU.
import type { GPUDevice, GPUTexture, GPUTextureFormat, GPUTextureView } from "../webgpu/webgpu_types";
import { TEXTURE_USAGE } from "../webgpu/webgpu_types";

/** A rectangle of a texture, pixels from the upper left corner. */
export interface Rectangle {
  x: number;
  y: number;
  width: number;
  height: number;
}

/** A level and a layer of a texture. */
export interface TexturePart {
  texture: GPUTexture;
  level: number;
  layer: number;
}

/** The attachments of the engine's render pass. */
export interface GpuEngineTarget {
  /** Its contents must be copyable (COPY_SRC). */
  colour: TexturePart;
  /** Of the same size and samples; null: objects do not hide splats. */
  depth: TexturePart | null;
  viewport: Rectangle & { minDepth: number; maxDepth: number };
  /** Pixels outside are not drawn; null: all are. */
  scissor: Rectangle | null;
}

/** The width and height of a part of a texture. */
export function sizeOf({ texture, level }: TexturePart): [number, number] {
  return [Math.max(1, texture.width >> level), Math.max(1, texture.height >> level)];
}

/** Creates a view of a part of a texture. */
export function viewOf({ texture, level, layer }: TexturePart): GPUTextureView {
  return texture.createView({
    dimension: "2d", baseMipLevel: level, mipLevelCount: 1, baseArrayLayer: layer, arrayLayerCount: 1,
  });
}

/** The pixels of a target that may be drawn; null if there are none. */
export function drawnPixels({ colour, viewport, scissor }: GpuEngineTarget): Rectangle | null {
  const [width, height] = sizeOf(colour);
  const all = [{ x: 0, y: 0, width, height }, viewport, ...(scissor === null ? [] : [scissor])];
  const left = Math.max(...all.map(({ x }) => x));
  const top = Math.max(...all.map(({ y }) => y));
  const right = Math.min(...all.map(({ x, width: w }) => x + w));
  const bottom = Math.min(...all.map(({ y, height: h }) => y + h));
  return right > left && bottom > top ? { x: left, y: top, width: right - left, height: bottom - top } : null;
}

/** A copy of the content of textures, for shaders that draw over them. */
export class ContentCopy {
  private copy: GPUTexture | null = null;

  constructor(private readonly device: GPUDevice) {}

  /** Copies a part of a texture. The view is valid until the next update. */
  update(part: TexturePart): GPUTextureView {
    const { texture, level, layer } = part;
    const size = sizeOf(part);
    const { format, sampleCount } = texture;
    const { copy, device } = this;
    if (copy === null || copy.width !== size[0] || copy.height !== size[1] || copy.format !== format ||
        copy.sampleCount !== sampleCount) {
      copy?.destroy();
      const { COPY_DST, TEXTURE_BINDING, RENDER_ATTACHMENT } = TEXTURE_USAGE;
      this.copy = device.createTexture({
        size, format: format as GPUTextureFormat, sampleCount,
        // Multisampled textures must be attachments, too.
        usage: COPY_DST | TEXTURE_BINDING | (sampleCount > 1 ? RENDER_ATTACHMENT : 0),
      });
    }
    const to = this.copy as GPUTexture;
    const encoder = device.createCommandEncoder();
    encoder.copyTextureToTexture(
      { texture, mipLevel: level, origin: [0, 0, layer] }, { texture: to }, size);
    device.queue.submit([encoder.finish()]);
    return to.createView();
  }

  destroy(): void {
    this.copy?.destroy();
    this.copy = null;
  }
}
