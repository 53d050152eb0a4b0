// SPDX-License-Identifier: Apache-2.0
import { viewUniforms } from "../camera";
import { padded } from "../packed_segment";
import type { Camera } from "../types";
import { Atlas } from "./atlas";
import type { Rows } from "./atlas";
import { created, Program, Table } from "./gl";
import { resolveFragment, resolveVertex, splatFragment, splatVertex } from "./shaders";
import { Target } from "./target";
import type { TargetFormat } from "./target";

/** A segment as it is drawn. */
export interface Drawn {
  primitives: number;
  shDegree: number;
  begin: number; // ticks of the timeline; end inclusive
  end: number;
  origin: number;
  /** Null: its words are not on the GPU, so it is not drawn. */
  rows: Rows | null;
}

/** Premultiplied RGBA, sRGB-encoded. */
export type Background = readonly [number, number, number, number];

function bindUnit(gl: WebGL2RenderingContext, program: Program, name: string, unit: number): void {
  gl.uniform1i(program.at(name), unit);
}

/** All GPU objects of a renderer, and the drawing of a frame. */
export class FrameDrawer {
  readonly atlas: Atlas;
  private readonly splats: Program;
  private readonly resolve: Program;
  private readonly target: Target;
  private readonly segments: Table;
  private readonly groups: Table;
  private readonly entries: WebGLBuffer;
  private readonly vertices: WebGLVertexArrayObject;
  private count = 0;

  /** Creates the objects. Throws an Error if a shader cannot be built. */
  constructor(private readonly gl: WebGL2RenderingContext, format: TargetFormat) {
    this.splats = new Program(gl, splatVertex, splatFragment);
    this.resolve = new Program(gl, resolveVertex, resolveFragment);
    this.atlas = new Atlas(gl);
    this.target = new Target(gl, format);
    this.segments = new Table(gl, 4);
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

  /**
   * Uploads an order: entries as those of Order, of segments that have `primitives` each and begin
   * at `bases`.
   */
  setOrder(entries: Uint32Array, primitives: number[], bases: number[]): void {
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

  /** Draws the order of `drawn` segments, which begin at `bases`, over the background. */
  draw(
    camera: Camera, ticks: number, drawn: readonly Drawn[], bases: readonly number[],
    background: Background,
  ): void {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE0);
    this.target.bind(camera.width, camera.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    if (this.count > 0) this.drawSplats(camera, ticks, drawn, bases);
    this.drawResolved(camera, background);
  }

  /** Reads the blended image, without the background. */
  read(): Float32Array {
    return this.target.read();
  }

  destroy(): void {
    this.atlas.destroy();
    this.target.destroy();
    this.segments.destroy();
    this.groups.destroy();
    this.gl.deleteBuffer(this.entries);
    this.gl.deleteVertexArray(this.vertices);
    this.gl.deleteProgram(this.splats.handle);
    this.gl.deleteProgram(this.resolve.handle);
  }

  private drawSplats(
    camera: Camera, ticks: number, drawn: readonly Drawn[], bases: readonly number[],
  ): void {
    const gl = this.gl;
    this.uploadSegments(ticks, drawn, bases);
    gl.useProgram(this.splats.handle);
    gl.uniform4fv(this.splats.at("view[0]"), viewUniforms(camera));
    gl.uniform1f(this.splats.at("height"), camera.height);
    this.atlas.bind(0);
    bindUnit(gl, this.splats, "atlas", 0);
    this.segments.bind(1);
    bindUnit(gl, this.splats, "segments", 1);
    this.groups.bind(2);
    bindUnit(gl, this.splats, "groups", 2);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.bindVertexArray(this.vertices);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.count);
    gl.bindVertexArray(null);
    gl.disable(gl.BLEND);
  }

  private drawResolved(camera: Camera, background: Background): void {
    const gl = this.gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, camera.width, camera.height);
    gl.useProgram(this.resolve.handle);
    gl.uniform4f(this.resolve.at("background"), ...background);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.target.texture);
    bindUnit(gl, this.resolve, "image", 0);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.bindTexture(gl.TEXTURE_2D, null);
  }

  /** Uploads `segments` of splat.vert.glsl. */
  private uploadSegments(
    ticks: number, drawn: readonly Drawn[], bases: readonly number[],
  ): void {
    const table = this.segments.stage(2 * drawn.length);
    const floats = new Float32Array(table.buffer);
    drawn.forEach((segment, k) => {
      const isShown = segment.rows !== null && segment.begin <= ticks && ticks <= segment.end;
      const local = ticks - segment.origin;
      table[8 * k] = segment.rows?.first ?? 0;
      table[8 * k + 1] = padded(segment.primitives);
      table[8 * k + 2] = segment.shDegree;
      table[8 * k + 3] = bases[k] as number;
      table[8 * k + 4] = isShown ? segment.primitives : 0;
      floats[8 * k + 5] = local;
      floats[8 * k + 6] = local - Math.fround(local);
    });
    this.gl.activeTexture(this.gl.TEXTURE1);
    this.segments.upload();
  }
}
