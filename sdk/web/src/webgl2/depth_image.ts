// SPDX-License-Identifier: Apache-2.0
import { created, Program, sampleNearest } from "./gl";
import { depthFragment, resolveVertex } from "./shaders";

/** The mean depth of the splats of an image: its sums, which are blended with the colours. */
export class DepthImage {
  /** Depth times alpha, and alpha, per pixel. */
  readonly sums: WebGLTexture;
  private readonly isFloat: boolean; // or half floats
  private readonly framebuffer: WebGLFramebuffer;
  private readonly resolve: Program;

  /** Throws an Error if the context cannot draw to floats. */
  constructor(private readonly gl: WebGL2RenderingContext) {
    if (gl.getExtension("EXT_color_buffer_float") === null && !gl.isContextLost()) {
      throw new Error("depth needs EXT_color_buffer_float, which this browser does not have");
    }
    this.isFloat = gl.getExtension("EXT_float_blend") !== null;
    this.sums = created(gl.createTexture(), "texture");
    this.framebuffer = created(gl.createFramebuffer(), "framebuffer");
    this.resolve = new Program(gl, resolveVertex, depthFragment);
  }

  /** Resizes it to an image, pixels. */
  resize(width: number, height: number): void {
    const { gl } = this;
    const [internal, type] = this.isFloat ? [gl.RGBA32F, gl.FLOAT] : [gl.RGBA16F, gl.HALF_FLOAT];
    gl.bindTexture(gl.TEXTURE_2D, this.sums);
    gl.texImage2D(gl.TEXTURE_2D, 0, internal, width, height, 0, gl.RGBA, type, null);
    sampleNearest(gl, gl.TEXTURE_2D);
  }

  /** Writes the depths into a texture of the size of the image. Throws an Error if its format is wrong. */
  write(to: WebGLTexture, width: number, height: number): void {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, to, 0);
    try {
      const status = gl.checkFramebufferStatus(gl.FRAMEBUFFER);
      if (status !== gl.FRAMEBUFFER_COMPLETE && !gl.isContextLost()) {
        throw new Error("the depth texture of a view cannot be drawn to (expected a texture in R32F)");
      }
      this.draw(width, height);
    } finally {
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, null, 0);
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    }
  }

  destroy(): void {
    this.gl.deleteTexture(this.sums);
    this.gl.deleteFramebuffer(this.framebuffer);
    this.gl.deleteProgram(this.resolve.handle);
  }

  private draw(width: number, height: number): void {
    const { gl, resolve } = this;
    gl.viewport(0, 0, width, height);
    gl.useProgram(resolve.handle);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.sums);
    gl.uniform1i(resolve.at("sums"), 0);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.bindTexture(gl.TEXTURE_2D, null);
  }
}
