// SPDX-License-Identifier: Apache-2.0
import { created, sampleNearest, succeeds } from "./gl";
import { RowAllocator } from "./rows";

/** Pairs of words per row; `kRowBits` of project.frag.glsl is its logarithm. */
const kRowPairs = 4096;
/** Rows per layer; `kLayerBits` of project.frag.glsl is its logarithm. A layer has 8 MiB. */
const kLayerRows = 256;

/** Rows of the atlas with the words of one segment. */
export interface Rows {
  first: number;
  count: number;
}

/**
 * The words of all segments in one texture, a 2D array that grows. While it grows, the old and the
 * new texture exist together.
 */
export class Atlas {
  private texture: WebGLTexture | null = null;
  private layers = 0;
  private readonly allocator = new RowAllocator();
  private readonly maxLayers: number;

  constructor(private readonly gl: WebGL2RenderingContext) {
    this.maxLayers = gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS);
  }

  /** Bytes of the texture. */
  get bytes(): number {
    return this.layers * kLayerRows * kRowPairs * 8;
  }

  /** Uploads the words of a segment, from where they are. Throws if the texture cannot grow. */
  add(words: Uint32Array): Rows {
    const count = Math.max(1, Math.ceil(words.length / (2 * kRowPairs)));
    let first = this.allocator.allocate(count);
    if (first < 0) {
      this.grow(Math.ceil(this.allocator.rowsFor(count) / kLayerRows));
      first = this.allocator.allocate(count);
    }
    this.upload(first, words);
    return { first, count };
  }

  /** Frees the rows of a segment. */
  remove(rows: Rows): void {
    this.allocator.release(rows.first, rows.count);
  }

  /** Binds the texture to a unit. */
  bind(unit: number): void {
    this.gl.activeTexture(this.gl.TEXTURE0 + unit);
    this.gl.bindTexture(this.gl.TEXTURE_2D_ARRAY, this.texture);
  }

  destroy(): void {
    this.gl.deleteTexture(this.texture);
  }

  /** Uploads rectangles: whole rows, layer by layer, then the rest of the last row. */
  private upload(first: number, words: Uint32Array): void {
    const whole = Math.floor(words.length / (2 * kRowPairs));
    this.gl.bindTexture(this.gl.TEXTURE_2D_ARRAY, this.texture);
    for (let row = 0; row < whole; ) {
      const rows = Math.min(whole - row, kLayerRows - ((first + row) % kLayerRows));
      this.put(first + row, kRowPairs, rows, words, 2 * kRowPairs * row);
      row += rows;
    }
    const rest = words.length / 2 - whole * kRowPairs;
    if (rest > 0) this.put(first + whole, rest, 1, words, 2 * kRowPairs * whole);
  }

  private put(row: number, width: number, rows: number, words: Uint32Array, at: number): void {
    const gl = this.gl;
    const layer = Math.floor(row / kLayerRows);
    gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, row % kLayerRows, layer, width, rows, 1,
      gl.RG_INTEGER, gl.UNSIGNED_INT, words, at);
  }

  private grow(needed: number): void {
    if (needed > this.maxLayers) {
      const limit = Math.floor((this.maxLayers * kLayerRows * kRowPairs * 8) / 2 ** 20);
      throw new Error(
        `the segments need more than ${limit} MiB of GPU memory; lower the memory budget`);
    }
    const gl = this.gl;
    const layers = Math.min(this.maxLayers, Math.max(needed, Math.ceil(1.5 * this.layers)));
    const texture = created(gl.createTexture(), "texture");
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, texture);
    const fits = succeeds(gl, () => gl.texStorage3D(
      gl.TEXTURE_2D_ARRAY, 1, gl.RG32UI, kRowPairs, kLayerRows, layers));
    if (!fits) {
      gl.deleteTexture(texture);
      throw new Error("the GPU has no memory for the segments; lower the memory budget");
    }
    sampleNearest(gl, gl.TEXTURE_2D_ARRAY);
    this.copyLayers();
    gl.deleteTexture(this.texture);
    this.texture = texture;
    this.layers = layers;
    this.allocator.grow(layers * kLayerRows);
  }

  /** Copies all layers to the bound texture, on the GPU. */
  private copyLayers(): void {
    if (this.texture === null) return;
    const gl = this.gl;
    const framebuffer = created(gl.createFramebuffer(), "framebuffer");
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, framebuffer);
    for (let layer = 0; layer < this.layers; ++layer) {
      gl.framebufferTextureLayer(
        gl.READ_FRAMEBUFFER, gl.COLOR_ATTACHMENT0, this.texture, 0, layer);
      gl.copyTexSubImage3D(
        gl.TEXTURE_2D_ARRAY, 0, 0, 0, layer, 0, 0, kRowPairs, kLayerRows);
    }
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, null);
    gl.deleteFramebuffer(framebuffer);
  }
}
