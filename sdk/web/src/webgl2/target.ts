// SPDX-License-Identifier: Apache-2.0
import type { RendererStatistics } from "../types";
import type { DepthImage } from "./depth_image";
import { created, sampleNearest } from "./gl";

/** How the splats of a frame are blended: in half floats, or in 8 bits per channel. */
export type TargetFormat = NonNullable<RendererStatistics["targetFormat"]>;

/**
 * Returns the best format that the context can blend, at most `wanted`. Enables the extension that
 * it needs.
 */
export function targetFormat(gl: WebGL2RenderingContext, wanted: TargetFormat): TargetFormat {
  if (wanted === "rgba8") return "rgba8";
  const extension =
    gl.getExtension("EXT_color_buffer_float") ?? gl.getExtension("EXT_color_buffer_half_float");
  return extension === null ? "rgba8" : "rgba16f";
}

/** The images into which splats are blended: premultiplied colours and alpha, and, if requested, their depth. */
export class Target {
  readonly texture: WebGLTexture;
  private readonly framebuffer: WebGLFramebuffer;
  width = 0;
  height = 0;

  constructor(
    private readonly gl: WebGL2RenderingContext, readonly format: TargetFormat,
    private readonly depth: DepthImage | null,
  ) {
    this.texture = created(gl.createTexture(), "texture");
    this.framebuffer = created(gl.createFramebuffer(), "framebuffer");
  }

  /** Resizes it to an image, pixels, and binds its framebuffer. */
  bind(width: number, height: number): void {
    const gl = this.gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    if (width !== this.width || height !== this.height) this.resize(width, height);
    gl.viewport(0, 0, width, height);
  }

  /** Reads the image, RGBA, row by row from the top. */
  read(): Float32Array {
    const gl = this.gl;
    const pixels = new Float32Array(4 * this.width * this.height);
    if (pixels.length === 0) return pixels;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    if (this.format === "rgba16f") {
      gl.readPixels(0, 0, this.width, this.height, gl.RGBA, gl.FLOAT, pixels);
    } else {
      const bytes = new Uint8Array(pixels.length);
      gl.readPixels(0, 0, this.width, this.height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
      for (let i = 0; i < bytes.length; ++i) pixels[i] = (bytes[i] as number) / 255;
    }
    this.flip(pixels);
    return pixels;
  }

  destroy(): void {
    this.gl.deleteFramebuffer(this.framebuffer);
    this.gl.deleteTexture(this.texture);
  }

  private resize(width: number, height: number): void {
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    if (this.format === "rgba16f") {
      gl.texImage2D(
        gl.TEXTURE_2D, 0, gl.RGBA16F, width, height, 0, gl.RGBA, gl.HALF_FLOAT, null);
    } else {
      gl.texImage2D(
        gl.TEXTURE_2D, 0, gl.RGBA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
    }
    sampleNearest(gl, gl.TEXTURE_2D);
    gl.framebufferTexture2D(
      gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.texture, 0);
    if (this.depth !== null) {
      this.depth.resize(width, height);
      gl.framebufferTexture2D(
        gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT1, gl.TEXTURE_2D, this.depth.sums, 0);
      gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
    }
    this.width = width;
    this.height = height;
  }

  private flip(pixels: Float32Array): void {
    const row = 4 * this.width;
    for (let y = 0; y < this.height >> 1; ++y) {
      const above = y * row;
      const below = (this.height - 1 - y) * row;
      const kept = pixels.slice(above, above + row);
      pixels.copyWithin(above, below, below + row);
      pixels.set(kept, below);
    }
  }
}
