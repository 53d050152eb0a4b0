// SPDX-License-Identifier: Apache-2.0
import { DepthImage } from "./depth_image";
import { Program } from "./gl";
import { resolveFragment, resolveVertex } from "./shaders";
import { Target } from "./target";
import type { TargetFormat } from "./target";

/** Premultiplied RGBA, sRGB-encoded. */
export type Background = readonly [number, number, number, number];

/** A rectangle of a framebuffer, pixels from its lower left corner. */
export interface Viewport {
  x: number;
  y: number;
  width: number;
  height: number;
}

/** The image in which splats are blended before it is shown over a background. */
export class Frame {
  private readonly target: Target;
  private readonly depth: DepthImage | null;
  private readonly resolve: Program;
  private width = 0;
  private height = 0;
  private isClear = true; // whether bind() has cleared the image

  /** Creates the objects. Throws an Error if a shader cannot be built, or if there can be no depth. */
  constructor(private readonly gl: WebGL2RenderingContext, format: TargetFormat, hasDepth: boolean) {
    this.depth = hasDepth ? new DepthImage(gl) : null;
    this.target = new Target(gl, format, this.depth);
    this.resolve = new Program(gl, resolveVertex, resolveFragment);
  }

  /** Begins an empty image of this size, pixels. */
  begin(width: number, height: number): void {
    this.width = width;
    this.height = height;
    this.isClear = false;
  }

  /** Binds the image, so that the following calls draw into it. */
  bind(): void {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE0);
    this.target.bind(this.width, this.height);
    if (this.isClear) return;
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    this.isClear = true;
  }

  /** Puts the image over a background into a rectangle of its size. `to` null: the canvas. */
  show(to: WebGLFramebuffer | null, at: Viewport, background: Background): void {
    const gl = this.gl;
    if (!this.isClear) this.bind();
    gl.bindFramebuffer(gl.FRAMEBUFFER, to);
    gl.viewport(at.x, at.y, at.width, at.height);
    gl.useProgram(this.resolve.handle);
    gl.uniform2i(this.resolve.at("origin"), at.x, at.y);
    gl.uniform4f(this.resolve.at("background"), ...background);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.target.texture);
    gl.uniform1i(this.resolve.at("image"), 0);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.bindTexture(gl.TEXTURE_2D, null);
  }

  /** Writes the mean depth of the splats into a texture. Only with depth, after show(). */
  writeDepth(to: WebGLTexture): void {
    this.depth?.write(to, this.width, this.height);
  }

  /** Reads the blended image, without the background. */
  read(): Float32Array {
    return this.target.read();
  }

  destroy(): void {
    this.target.destroy();
    this.depth?.destroy();
    this.gl.deleteProgram(this.resolve.handle);
  }
}
