// SPDX-License-Identifier: Apache-2.0
import { created, Table } from "./gl";
import { padded } from "../packed_segment";

/** An order on the GPU: the entries as instances, and the segment of each group of 256 entries. */
export class OrderBuffers {
  private readonly groups: Table;
  private readonly entries: WebGLBuffer;
  private readonly vertices: WebGLVertexArrayObject;
  private count = 0;

  constructor(private readonly gl: WebGL2RenderingContext) {
    this.groups = new Table(gl, 1);
    this.entries = created(gl.createBuffer(), "buffer");
    this.vertices = created(gl.createVertexArray(), "vertex array");
    gl.bindVertexArray(this.vertices);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.entries);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribIPointer(0, 1, gl.UNSIGNED_INT, 0, 0);
    gl.vertexAttribDivisor(0, 1);
    gl.bindVertexArray(null);
  }

  get isEmpty(): boolean {
    return this.count === 0;
  }

  /**
   * Uploads an order: entries as those of Order, of segments that have `primitives` each and begin
   * at `bases`.
   */
  upload(entries: Uint32Array, primitives: number[], bases: number[]): void {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.entries);
    gl.bufferData(gl.ARRAY_BUFFER, entries, gl.STREAM_DRAW);
    this.count = entries.length;
    const last = bases.length - 1;
    const total = last < 0 ? 0 : (bases[last] as number) + padded(primitives[last] as number);
    const groups = this.groups.stage(total / 256);
    bases.forEach((base, k) => {
      const first = base / 256;
      groups.fill(k, first, first + padded(primitives[k] as number) / 256);
    });
    gl.activeTexture(gl.TEXTURE0);
    this.groups.upload();
  }

  /** Binds the table of groups to a texture unit. */
  bindGroups(unit: number): void {
    this.groups.bind(unit);
  }

  /** Draws four vertices per entry with the current program. */
  draw(): void {
    const gl = this.gl;
    gl.bindVertexArray(this.vertices);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.count);
    gl.bindVertexArray(null);
  }

  destroy(): void {
    this.groups.destroy();
    this.gl.deleteBuffer(this.entries);
    this.gl.deleteVertexArray(this.vertices);
  }
}
