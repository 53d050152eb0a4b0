// SPDX-License-Identifier: Apache-2.0
import { viewUniforms } from "../camera";
import { padded } from "../packed_segment";
import type { Camera } from "../types";
import { Atlas } from "./atlas";
import type { Rows } from "./atlas";
import { Program, Table } from "./gl";
import type { OrderTextures } from "./order_textures";
import { kMaxRecords, kRecordRow, Records } from "./records";
import {
  projectFragment, resolveVertex, splatDepthFragment, splatFragment, splatVertex,
} from "./shaders";

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
  /** Binds the framebuffer and sets the viewport. May be called several times per image. */
  bind(): void;
  /** Left and top edge of the image in the framebuffer, pixels from its lower left corner. */
  left: number;
  top: number;
  /** [a, b, c]: a splat at z in front of the camera has depth a + b / z + c log2(1 + z) in NDC. */
  depth: readonly [number, number, number];
  /** Whether colours are converted from sRGB to linear values. */
  isLinear: boolean;
}

/** Returns the output of an image that fills a framebuffer without a depth buffer. */
export function imageOutput(height: number, bind: () => void): SplatOutput {
  return { bind, left: 0, top: height, depth: [0, 0, 0], isLinear: false };
}

/** A scene as an image shows it. */
export interface SplatImage {
  camera: Camera;
  ticks: number;
  kernel: number; // of the splats
}

/** The GPU objects of a scene but its orders, and the drawing of its splats. */
export class SplatDrawer {
  readonly atlas: Atlas;
  private readonly projection: Program;
  private readonly splats: Program;
  private readonly segments: Table;
  private readonly records: Records;

  /** Creates the objects. Throws an Error if a shader cannot be built. */
  constructor(private readonly gl: WebGL2RenderingContext, hasDepth: boolean) {
    this.projection = new Program(gl, resolveVertex, projectFragment);
    this.splats = new Program(gl, splatVertex, hasDepth ? splatDepthFragment : splatFragment);
    this.atlas = new Atlas(gl);
    this.segments = new Table(gl, 4);
    this.records = new Records(gl);
  }

  /** Prepares to draw an order. Throws an Error if the GPU has no memory. */
  reserve(order: OrderTextures): void {
    this.records.reserve(order.count);
  }

  /**
   * Blends an order of `drawn` segments, which begin at `bases`, into an output. Disables blending;
   * the depth test and the scissor test are those of the caller.
   */
  draw(
    image: SplatImage, drawn: readonly Drawn[], bases: readonly number[],
    output: SplatOutput, order: OrderTextures,
  ): void {
    const { gl } = this;
    if (order.count === 0 || !this.records.holds(order.count)) return;
    const hasScissor = gl.isEnabled(gl.SCISSOR_TEST);
    this.uploadSegments(image.ticks, drawn, bases);
    for (let first = 0; first < order.count; first += kMaxRecords) {
      const count = Math.min(kMaxRecords, order.count - first);
      if (hasScissor) gl.disable(gl.SCISSOR_TEST);
      this.project(image, output.isLinear, order, first, count);
      output.bind();
      if (hasScissor) gl.enable(gl.SCISSOR_TEST);
      this.blend(image.camera, output, count);
    }
  }

  destroy(): void {
    this.atlas.destroy();
    this.segments.destroy();
    this.records.destroy();
    this.gl.deleteProgram(this.projection.handle);
    this.gl.deleteProgram(this.splats.handle);
  }

  /** Computes the splats of `count` entries of the order, without blending. */
  private project(
    { camera, kernel }: SplatImage, isLinear: boolean, order: OrderTextures, first: number, count: number,
  ): void {
    const { gl, projection } = this;
    gl.useProgram(projection.handle);
    gl.uniform4fv(projection.at("view[0]"), viewUniforms(camera, kernel));
    gl.uniform1i(projection.at("is_linear"), isLinear ? 1 : 0);
    gl.uniform1ui(projection.at("first_row"), first / kRecordRow);
    gl.uniform1ui(projection.at("count"), count);
    this.atlas.bind(0);
    this.segments.bind(1);
    order.bind(2);
    ["atlas", "segments", "groups", "order"].forEach(
      (name, unit) => gl.uniform1i(projection.at(name), unit));
    this.records.write(count);
  }

  /** Blends the first `count` splats into the bound framebuffer. */
  private blend(camera: Camera, output: SplatOutput, count: number): void {
    const { gl, splats } = this;
    gl.useProgram(splats.handle);
    gl.uniform2f(splats.at("image_size"), camera.width, camera.height);
    gl.uniform2f(splats.at("origin"), output.left, output.top);
    gl.uniform3f(splats.at("depth_mapping"), ...output.depth);
    this.records.bind(0);
    ["records_a", "records_b"].forEach((name, unit) => gl.uniform1i(splats.at(name), unit));
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.records.draw(count);
    gl.disable(gl.BLEND);
  }

  /** Uploads `segments` of project.frag.glsl. */
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
