// SPDX-License-Identifier: Apache-2.0

/** Returns an object that WebGL created; `kind` names it. Throws if it is null, as it is once the context is lost. */
export function created<T>(object: T | null, kind: string): T {
  if (object === null) throw new Error(`WebGL cannot create a ${kind}: the context is lost`);
  return object;
}

function compile(gl: WebGL2RenderingContext, type: number, text: string): WebGLShader {
  const shader = created(gl.createShader(type), "shader");
  gl.shaderSource(shader, text);
  gl.compileShader(shader);
  return shader;
}

/** A linked program and the locations of its uniforms. */
export class Program {
  readonly handle: WebGLProgram;
  private readonly locations = new Map<string, WebGLUniformLocation>();

  /** Compiles and links. Throws an Error with the log of the compiler. */
  constructor(private readonly gl: WebGL2RenderingContext, vertex: string, fragment: string) {
    this.handle = created(gl.createProgram(), "program");
    const shaders = [
      compile(gl, gl.VERTEX_SHADER, vertex),
      compile(gl, gl.FRAGMENT_SHADER, fragment),
    ];
    for (const shader of shaders) gl.attachShader(this.handle, shader);
    gl.linkProgram(this.handle);
    if (!gl.getProgramParameter(this.handle, gl.LINK_STATUS) && !gl.isContextLost()) {
      const logs = shaders.map((shader) => gl.getShaderInfoLog(shader) ?? "");
      logs.push(gl.getProgramInfoLog(this.handle) ?? "");
      throw new Error(`cannot build a shader: ${logs.join(" ")}`);
    }
    for (const shader of shaders) gl.deleteShader(shader);
  }

  /** Returns the location of a uniform, or null if the shaders do not use it. */
  at(name: string): WebGLUniformLocation | null {
    const known = this.locations.get(name);
    if (known !== undefined) return known;
    const location = this.gl.getUniformLocation(this.handle, name);
    if (location !== null) this.locations.set(name, location);
    return location;
  }
}

/** Sets the sampling of the bound texture: texels as they are. */
export function sampleNearest(gl: WebGL2RenderingContext, target: number): void {
  gl.texParameteri(target, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(target, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  gl.texParameteri(target, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
  gl.texParameteri(target, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
}

/** Calls `allocate`. Returns whether it had no error, such as a lack of GPU memory. */
export function succeeds(gl: WebGL2RenderingContext, allocate: () => void): boolean {
  while (gl.getError() !== gl.NO_ERROR && !gl.isContextLost());
  allocate();
  return gl.getError() === gl.NO_ERROR || gl.isContextLost();
}

/**
 * Makes the bound 2D texture one of unsigned integers, without filtering. Returns false if it is too large
 * for the GPU.
 */
export function allocateTexture(
  gl: WebGL2RenderingContext, internal: number, format: number, width: number, height: number,
): boolean {
  sampleNearest(gl, gl.TEXTURE_2D);
  return succeeds(gl, () => gl.texImage2D(
    gl.TEXTURE_2D, 0, internal, width, height, 0, format, gl.UNSIGNED_INT, null));
}

/** Texels per row of a Table; `kTableBits` of project.frag.glsl is its logarithm. */
const kTableWidth = 1024;

/** A list of integers in a texture, with one or four of them to a texel. */
export class Table {
  private readonly texture: WebGLTexture;
  private rows = 0;
  private staging = new Uint32Array(0);

  constructor(private readonly gl: WebGL2RenderingContext, private readonly channels: 1 | 4) {
    this.texture = created(gl.createTexture(), "texture");
  }

  /**
   * Returns an array for at least `texels` texels, to be filled before upload(). Its contents are
   * unspecified.
   */
  stage(texels: number): Uint32Array {
    const rows = Math.max(1, Math.ceil(texels / kTableWidth));
    const size = rows * kTableWidth * this.channels;
    if (this.staging.length !== size) this.staging = new Uint32Array(size);
    return this.staging;
  }

  /** Uploads the staged array. Uses the active texture unit. */
  upload(): void {
    const gl = this.gl;
    const rows = this.staging.length / (kTableWidth * this.channels);
    const format = this.channels === 1 ? gl.RED_INTEGER : gl.RGBA_INTEGER;
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    if (rows === this.rows) {
      gl.texSubImage2D(
        gl.TEXTURE_2D, 0, 0, 0, kTableWidth, rows, format, gl.UNSIGNED_INT, this.staging);
      return;
    }
    this.rows = rows;
    const internal = this.channels === 1 ? gl.R32UI : gl.RGBA32UI;
    gl.texImage2D(
      gl.TEXTURE_2D, 0, internal, kTableWidth, rows, 0, format, gl.UNSIGNED_INT, this.staging);
    sampleNearest(gl, gl.TEXTURE_2D);
  }

  /** Binds the texture to a unit. */
  bind(unit: number): void {
    this.gl.activeTexture(this.gl.TEXTURE0 + unit);
    this.gl.bindTexture(this.gl.TEXTURE_2D, this.texture);
  }

  destroy(): void {
    this.gl.deleteTexture(this.texture);
  }
}
