// SPDX-License-Identifier: Apache-2.0
import { allocateTexture, created } from "./gl";

/** Records per row; `kRecordRow` of record.glsl. */
export const kRecordRow = 4096;
/** Rows at most, 32 MiB. A larger order is drawn in parts. */
const kMaxRows = 256;
/** Records at most, of one part of an order. */
export const kMaxRecords = kMaxRows * kRecordRow;
/** Splats per instance of the draw; `kQuads` of splat.vert.glsl. */
const kQuads = 64;

/** The splats of a part of an order, which are computed once per frame and drawn from there. */
export class Records {
  private readonly textures: [WebGLTexture, WebGLTexture];
  private readonly framebuffer: WebGLFramebuffer;
  private readonly vertices: WebGLVertexArrayObject; // without attributes
  private readonly indices: WebGLBuffer; // of the corners of kQuads splats
  private rows = 0;

  constructor(private readonly gl: WebGL2RenderingContext) {
    this.textures = [created(gl.createTexture(), "texture"), created(gl.createTexture(), "texture")];
    this.framebuffer = created(gl.createFramebuffer(), "framebuffer");
    this.vertices = created(gl.createVertexArray(), "vertex array");
    this.indices = created(gl.createBuffer(), "buffer");
    const corners = Array.from({ length: kQuads }, (_, k) => [0, 1, 2, 2, 1, 3].map((c) => 4 * k + c));
    gl.bindVertexArray(this.vertices);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.indices);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint16Array(corners.flat()), gl.STATIC_DRAW);
    gl.bindVertexArray(null);
  }

  /** Enlarges the textures for the parts of an order. Throws an Error if the GPU has no memory. */
  reserve(count: number): void {
    const rows = Math.min(kMaxRows, Math.ceil(count / kRecordRow));
    if (rows <= this.rows) return;
    const { gl, textures } = this;
    const enlarged = Math.min(kMaxRows, Math.max(rows, Math.ceil(1.25 * this.rows)));
    this.rows = 0;
    gl.activeTexture(gl.TEXTURE0);
    const fits = textures.every((texture) => {
      gl.bindTexture(gl.TEXTURE_2D, texture);
      return allocateTexture(gl, gl.RGBA32UI, gl.RGBA_INTEGER, kRecordRow, enlarged);
    });
    if (!fits) throw new Error("the GPU has no memory for the splats of a frame; lower the memory budget");
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, this.framebuffer);
    const attachments = [gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1];
    attachments.forEach((attachment, k) => gl.framebufferTexture2D(
      gl.DRAW_FRAMEBUFFER, attachment, gl.TEXTURE_2D, textures[k] as WebGLTexture, 0));
    gl.drawBuffers(attachments);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    this.rows = enlarged;
  }

  /** Whether a part of an order fits. */
  holds(count: number): boolean {
    return Math.min(count, kMaxRecords) <= this.rows * kRecordRow;
  }

  /** Writes the first `count` records with the current program, a fragment for each. */
  write(count: number): void {
    const { gl } = this;
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, this.framebuffer);
    gl.viewport(0, 0, kRecordRow, Math.ceil(count / kRecordRow));
    gl.bindVertexArray(this.vertices);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.bindVertexArray(null);
  }

  /** Draws the splats of the first `count` records with the current program, in their order. */
  draw(count: number): void {
    const { gl } = this;
    gl.bindVertexArray(this.vertices);
    gl.drawElementsInstanced(
      gl.TRIANGLES, 6 * kQuads, gl.UNSIGNED_SHORT, 0, Math.ceil(count / kQuads));
    gl.bindVertexArray(null);
  }

  /** Binds the textures to two successive units. */
  bind(unit: number): void {
    const { gl } = this;
    this.textures.forEach((texture, k) => {
      gl.activeTexture(gl.TEXTURE0 + unit + k);
      gl.bindTexture(gl.TEXTURE_2D, texture);
    });
  }

  destroy(): void {
    const { gl } = this;
    gl.deleteFramebuffer(this.framebuffer);
    for (const texture of this.textures) gl.deleteTexture(texture);
    gl.deleteVertexArray(this.vertices);
    gl.deleteBuffer(this.indices);
  }
}
