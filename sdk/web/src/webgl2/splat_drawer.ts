// SPDX-License-Identifier: Apache-2.0
import { viewUniforms } from "../camera";
import { padded } from "../packed_segment";
import type { Camera } from "../types";
import { Atlas } from "./atlas";
import type { Rows } from "./atlas";
import { Program, Table } from "./gl";
import type { OrderBuffers } from "./order_buffers";
import { splatFragment, splatVertex } from "./shaders";

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

/** Where the splats of an image are drawn, and in which form. */
export interface SplatOutput {
  /** Left and top edge of the image in the framebuffer, pixels from its lower left corner. */
  left: number;
  top: number;
  /** [a, b, c]: a splat at z in front of the camera has depth a + b / z + c log2(1 + z) in NDC. */
  depth: readonly [number, number, number];
  /** Whether colours are converted from sRGB to linear values. */
  isLinear: boolean;
}

/** Returns the output of an image that fills a framebuffer without a depth buffer. */
export function imageOutput(height: number): SplatOutput {
  return { left: 0, top: height, depth: [0, 0, 0], isLinear: false };
}

/** The GPU objects of a scene but its orders, and the drawing of its splats. */
export class SplatDrawer {
  readonly atlas: Atlas;
  private readonly splats: Program;
  private readonly segments: Table;
  /** Creates the objects. Throws an Error if a shader cannot be built. */
  constructor(private readonly gl: WebGL2RenderingContext) {
    this.splats = new Program(gl, splatVertex, splatFragment);
    this.atlas = new Atlas(gl);
    this.segments = new Table(gl, 4);
  }

  /**
   * Blends an order of `drawn` segments, which begin at `bases`, over the bound framebuffer, in
   * the current viewport. Enables blending; the depth test is that of the caller.
   */
  draw(
    camera: Camera, ticks: number, drawn: readonly Drawn[], bases: readonly number[],
    output: SplatOutput, order: OrderBuffers,
  ): void {
    if (order.isEmpty) return;
    const { gl, splats } = this;
    this.uploadSegments(ticks, drawn, bases);
    gl.useProgram(splats.handle);
    gl.uniform4fv(splats.at("view[0]"), viewUniforms(camera));
    gl.uniform2f(splats.at("origin"), output.left, output.top);
    gl.uniform3f(splats.at("depth_mapping"), ...output.depth);
    gl.uniform1i(splats.at("is_linear"), output.isLinear ? 1 : 0);
    this.atlas.bind(0);
    this.segments.bind(1);
    order.bindGroups(2);
    ["atlas", "segments", "groups"].forEach((name, unit) => gl.uniform1i(splats.at(name), unit));
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    order.draw();
    gl.disable(gl.BLEND);
  }

  destroy(): void {
    this.atlas.destroy();
    this.segments.destroy();
    this.gl.deleteProgram(this.splats.handle);
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
