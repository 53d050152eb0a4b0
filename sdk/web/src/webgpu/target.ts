// SPDX-License-Identifier: Apache-2.0
import { BUFFER_USAGE, MAP_MODE_READ, TEXTURE_USAGE } from "./webgpu_types";
import type { GPUDevice, GPUTexture, GPUTextureView } from "./webgpu_types";

/** The format in which splats are blended. */
export const kTargetFormat = "rgba16float";

/** Returns the value of the bits of a half float. */
function valueOfHalf(bits: number): number {
  const sign = (bits & 0x8000) === 0 ? 1 : -1;
  const exponent = (bits >> 10) & 31;
  const fraction = bits & 1023;
  if (exponent === 31) return fraction === 0 ? sign * Infinity : NaN;
  if (exponent === 0) return sign * fraction * 2 ** -24;
  return sign * (1024 + fraction) * 2 ** (exponent - 25);
}

/** The image into which splats are blended: premultiplied colours and alpha. */
export class Target {
  private texture: GPUTexture | null = null;
  private current: GPUTextureView | null = null;

  constructor(private readonly device: GPUDevice) {}

  /** Only after resize(). */
  get view(): GPUTextureView {
    return this.current as GPUTextureView;
  }

  /** Makes it the size of an image, pixels. Returns whether `view` was replaced. */
  resize(width: number, height: number): boolean {
    if (this.texture?.width === width && this.texture.height === height) return false;
    const limit = this.device.limits.maxTextureDimension2D;
    if (width > limit || height > limit) {
      throw new Error(
        `an image of ${width}x${height} pixels is larger than this GPU draws (${limit})`);
    }
    this.texture?.destroy();
    this.texture = this.device.createTexture({
      size: [width, height], format: kTargetFormat,
      usage: TEXTURE_USAGE.RENDER_ATTACHMENT | TEXTURE_USAGE.TEXTURE_BINDING | TEXTURE_USAGE.COPY_SRC,
    });
    this.current = this.texture.createView();
    return true;
  }

  /** Reads the image, RGBA, row by row from the top. */
  async read(): Promise<Float32Array> {
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
  }
}
