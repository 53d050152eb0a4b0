// SPDX-License-Identifier: Apache-2.0
// Reads the exact pixels of lossless WebP images. A 2D canvas would multiply colours by alpha, so
// images are read through a texture.

// Not listed by TypeScript 4.8.
declare class OffscreenCanvas {
  constructor(width: number, height: number);
  getContext(kind: "webgl2"): WebGL2RenderingContext | null;
}

const RIFF_HEADER = 20;
const STREAM_HEADER = 5;

/**
 * Returns a file that contains only a lossless stream (RFC 9649, 2.6), because browsers apply colour
 * profiles and orientations. The bit for the use of alpha is set, because browsers drop alpha without
 * it; decoding does not depend on it.
 */
function webpFile(stream: Uint8Array): Blob {
  const padding = stream.length % 2;
  const header = new Uint8Array(RIFF_HEADER + STREAM_HEADER);
  const view = new DataView(header.buffer);
  const setText = (at: number, text: string) => header.set(Array.from(text, (char) => char.charCodeAt(0)), at);
  setText(0, "RIFF");
  view.setUint32(4, RIFF_HEADER - 8 + stream.length + padding, true);
  setText(8, "WEBPVP8L");
  view.setUint32(16, stream.length, true);
  header.set(stream.subarray(0, STREAM_HEADER), RIFF_HEADER);
  header[RIFF_HEADER + 4] |= 0x10;
  return new Blob([header, stream.subarray(STREAM_HEADER), new Uint8Array(padding)], { type: "image/webp" });
}

/** The lossless stream of an image of 16 x 16 pixels: pixel i is (255 - i, 3 i, 128 + i, i) modulo 256. */
const PROBE = "Lw/AAxBNZET/YxGFKHj/A2QCFkMh/Qs6vYf/n8CFmACWrOVd";
const PROBE_SIDE = 16;

/** Reads images exactly. Methods throw errors with messages for display, without the name of the image. */
export class ImageReader {
  private constructor(private readonly gl: WebGL2RenderingContext) {}

  /** Creates a reader. Rejects if the browser cannot decode images in workers, or alters their values. */
  static async create(): Promise<ImageReader> {
    const canvas = typeof OffscreenCanvas === "undefined" ? null : new OffscreenCanvas(1, 1);
    const gl = canvas?.getContext("webgl2") ?? null;
    if (gl === null) throw new Error("this browser has no WebGL2 in workers, which reading images requires; use 'stgs convert'");
    const reader = new ImageReader(gl);
    const stream = Uint8Array.from(atob(PROBE), (char) => char.charCodeAt(0));
    const pixels = new Uint8Array(4 * PROBE_SIDE * PROBE_SIDE);
    await reader.read(stream, PROBE_SIDE, pixels);
    const isExact = pixels.every((value, at) => {
      const i = at >> 2;
      return value === ([255 - i, 3 * i, 128 + i, i][at & 3]! & 255);
    });
    if (!isExact) throw new Error("this browser alters the pixels of images, perhaps to protect privacy; use 'stgs convert'");
    return reader;
  }

  /** Fills `output` with the R G B A values of a lossless stream, row after row from the top. `width`: pixels. */
  async read(stream: Uint8Array, width: number, output: Uint8Array): Promise<void> {
    const height = output.length / 4 / width;
    const limit = this.gl.getParameter(this.gl.MAX_TEXTURE_SIZE) as number;
    if (Math.max(width, height) > limit) {
      throw new Error(`${width} x ${height} pixels exceed the limit of the GPU (${limit} per side); use 'stgs convert'`);
    }
    let image: ImageBitmap;
    try {
      image = await createImageBitmap(webpFile(stream), { premultiplyAlpha: "none", colorSpaceConversion: "none" });
    } catch {
      throw new Error("the image is damaged or truncated, or the browser cannot decode it");
    }
    try {
      if (image.width !== width || image.height !== height) throw new Error("the image is damaged");
      this.readPixels(image, output);
    } finally {
      image.close();
    }
  }

  private readPixels(image: ImageBitmap, output: Uint8Array): void {
    const { gl } = this;
    gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
    gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
    const texture = gl.createTexture(), framebuffer = gl.createFramebuffer();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, image);
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    gl.readPixels(0, 0, image.width, image.height, gl.RGBA, gl.UNSIGNED_BYTE, output);
    const failed = gl.getError() !== gl.NO_ERROR || gl.isContextLost();
    gl.deleteFramebuffer(framebuffer);
    gl.deleteTexture(texture);
    if (failed) throw new Error("the GPU ran out of memory or was lost; use 'stgs convert'");
  }
}
