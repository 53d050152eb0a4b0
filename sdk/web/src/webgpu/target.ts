// SPDX-License-Identifier: Apache-2.0
import { BUFFER_USAGE, MAP_MODE_READ, TEXTURE_USAGE } from "./webgpu_types";
import type { GPUDevice, GPUTexture, GPUTextureFormat, GPUTextureView } from "./webgpu_types";

/** The format in which splats are blended. */
export const kTargetFormat = "rgba16float";

/** The greatest finite half float. */
export const kMaxHalf = 65504;

/** The format of the sums of depth and alpha: half floats if the device cannot blend 32-bit floats. */
export function depthSumsFormat(device: GPUDevice): GPUTextureFormat {
  return device.features.has("float32-blendable") ? "rg32float" : "rg16float";
}

/** Returns the value of the bits of a half float. */
function valueOfHalf(bits: number): number {
  const sign = (bits & 0x8000) === 0 ? 1 : -1;
  const exponent = (bits >> 10) & 31;
  const fraction = bits & 1023;
  if (exponent === 31) return fraction === 0 ? sign * Infinity : NaN;
  if (exponent === 0) return sign * fraction * 2 ** -24;
  return sign * (1024 + fraction) * 2 ** (exponent - 25);
}

/**
 * The images into which splats are blended: premultiplied colours and alpha, and, if requested, the sums
 * of depths.
 */
export class Target {
  private texture: GPUTexture | null = null;
  private depthTexture: GPUTexture | null = null;
  private current: GPUTextureView | null = null;
  private currentDepth: GPUTextureView | null = null;

  /** `samples`: 1 or 4 per pixel. */
  constructor(
    private readonly device: GPUDevice, private readonly hasDepth: boolean,
    private readonly samples = 1,
  ) {}

  /** Only after resize(). */
  get view(): GPUTextureView {
    return this.current as GPUTextureView;
  }

  /** Depth times alpha, and alpha; only after resize(), with depth. */
  get depthView(): GPUTextureView | null {
    return this.currentDepth;
  }

  /** Resizes it to an image, pixels. Returns whether the views were replaced. */
  resize(width: number, height: number): boolean {
    if (this.texture?.width === width && this.texture.height === height) return false;
    const limit = this.device.limits.maxTextureDimension2D;
    if (width > limit || height > limit) {
      throw new Error(
        `an image of ${width}x${height} pixels is larger than this GPU draws (${limit})`);
    }
    this.destroy();
    const { RENDER_ATTACHMENT, TEXTURE_BINDING, COPY_SRC } = TEXTURE_USAGE;
    this.texture = this.device.createTexture({
      size: [width, height], format: kTargetFormat, sampleCount: this.samples,
      usage: RENDER_ATTACHMENT | TEXTURE_BINDING | COPY_SRC,
    });
    this.current = this.texture.createView();
    if (!this.hasDepth) return true;
    this.depthTexture = this.device.createTexture({
      size: [width, height], format: depthSumsFormat(this.device),
      usage: RENDER_ATTACHMENT | TEXTURE_BINDING,
    });
    this.currentDepth = this.depthTexture.createView();
    return true;
  }

  /** Reads the image, RGBA, row by row from the top. Rejects if it has 4 samples per pixel. */
  async read(): Promise<Float32Array> {
    if (this.samples !== 1) throw new Error(`an image with ${this.samples} samples per pixel cannot be read`);
    if (this.texture === null) return new Float32Array(0);
    const { width, height } = this.texture;
    const rowBytes = Math.ceil((8 * width) / 256) * 256;
    const copy = this.device.createBuffer({
      size: rowBytes * height, usage: BUFFER_USAGE.COPY_DST | BUFFER_USAGE.MAP_READ,
    });
    const encoder = this.device.createCommandEncoder();
    encoder.copyTextureToBuffer(
      { texture: this.texture }, { buffer: copy, bytesPerRow: rowBytes }, [width, height]);
    this.device.queue.submit([encoder.finish()]);
    await copy.mapAsync(MAP_MODE_READ);
    const halves = new Uint16Array(copy.getMappedRange());
    const pixels = new Float32Array(4 * width * height);
    for (let y = 0; y < height; ++y) {
      const row = halves.subarray((y * rowBytes) / 2, (y * rowBytes) / 2 + 4 * width);
      row.forEach((bits, x) => { pixels[4 * width * y + x] = valueOfHalf(bits); });
    }
    copy.destroy();
    return pixels;
  }

  destroy(): void {
    this.texture?.destroy();
    this.depthTexture?.destroy();
  }
}
