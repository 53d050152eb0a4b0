// SPDX-License-Identifier: Apache-2.0
// The state of a WebGL2 context that a 3D engine tracks, preserved around calls of our own.

/** Texture units that the shaders use. */
const kUnits = 4;

/** Ways to unpack texture data that are not those of a new context. */
const kUnpackDefaults = [
  ["UNPACK_ALIGNMENT", 4], ["UNPACK_FLIP_Y_WEBGL", false],
  ["UNPACK_PREMULTIPLY_ALPHA_WEBGL", false], ["UNPACK_IMAGE_HEIGHT", 0], ["UNPACK_ROW_LENGTH", 0],
  ["UNPACK_SKIP_IMAGES", 0], ["UNPACK_SKIP_PIXELS", 0], ["UNPACK_SKIP_ROWS", 0],
] as const;

const kSwitches = [
  "BLEND", "CULL_FACE", "DEPTH_TEST", "POLYGON_OFFSET_FILL", "RASTERIZER_DISCARD",
  "SAMPLE_ALPHA_TO_COVERAGE", "SAMPLE_COVERAGE", "STENCIL_TEST",
] as const;

/**
 * Calls `work`, which creates and uploads objects or draws splats, and restores all state that it
 * changes. During `work`, data is unpacked as in a new context.
 */
export function preserveState<T>(gl: WebGL2RenderingContext, work: () => T): T {
  if (gl.isContextLost()) return work();
  const restores = [saveTextures(gl), saveBindings(gl), saveUnpacking(gl), saveDrawing(gl)];
  try {
    return work();
  } finally {
    for (const restore of restores) restore();
  }
}

function saveTextures(gl: WebGL2RenderingContext): () => void {
  const active: number = gl.getParameter(gl.ACTIVE_TEXTURE);
  const units = Array.from({ length: kUnits }, (_, unit) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    const sampler: WebGLSampler | null = gl.getParameter(gl.SAMPLER_BINDING);
    gl.bindSampler(unit, null);
    return {
      sampler,
      plane: gl.getParameter(gl.TEXTURE_BINDING_2D) as WebGLTexture | null,
      array: gl.getParameter(gl.TEXTURE_BINDING_2D_ARRAY) as WebGLTexture | null,
    };
  });
  gl.activeTexture(gl.TEXTURE0);
  return () => {
    units.forEach(({ sampler, plane, array }, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, plane);
      gl.bindTexture(gl.TEXTURE_2D_ARRAY, array);
      gl.bindSampler(unit, sampler);
    });
    gl.activeTexture(active);
  };
}

function saveBindings(gl: WebGL2RenderingContext): () => void {
  const program: WebGLProgram | null = gl.getParameter(gl.CURRENT_PROGRAM);
  const vertices: WebGLVertexArrayObject | null = gl.getParameter(gl.VERTEX_ARRAY_BINDING);
  const buffer: WebGLBuffer | null = gl.getParameter(gl.ARRAY_BUFFER_BINDING);
  const pixels: WebGLBuffer | null = gl.getParameter(gl.PIXEL_UNPACK_BUFFER_BINDING);
  const source: WebGLFramebuffer | null = gl.getParameter(gl.READ_FRAMEBUFFER_BINDING);
  const target: WebGLFramebuffer | null = gl.getParameter(gl.DRAW_FRAMEBUFFER_BINDING);
  gl.bindBuffer(gl.PIXEL_UNPACK_BUFFER, null);
  return () => {
    gl.useProgram(program);
    gl.bindVertexArray(vertices);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bindBuffer(gl.PIXEL_UNPACK_BUFFER, pixels);
    gl.bindFramebuffer(gl.READ_FRAMEBUFFER, source);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, target);
  };
}

function saveUnpacking(gl: WebGL2RenderingContext): () => void {
  const values = kUnpackDefaults.map(([name, value]) => {
    const saved: number | boolean = gl.getParameter(gl[name]);
    gl.pixelStorei(gl[name], value);
    return saved;
  });
  return () => values.forEach((value, k) => {
    const [name] = kUnpackDefaults[k] as typeof kUnpackDefaults[number];
    gl.pixelStorei(gl[name], value);
  });
}

function saveDrawing(gl: WebGL2RenderingContext): () => void {
  const switches = kSwitches.map((name) => gl.isEnabled(gl[name]));
  const writesDepth: boolean = gl.getParameter(gl.DEPTH_WRITEMASK);
  const writesColour: [boolean, boolean, boolean, boolean] = gl.getParameter(gl.COLOR_WRITEMASK);
  const compares: number = gl.getParameter(gl.DEPTH_FUNC);
  const viewport: Int32Array = gl.getParameter(gl.VIEWPORT);
  const [sourceColour, toColour, sourceAlpha, toAlpha, colour, alpha] = [
    gl.BLEND_SRC_RGB, gl.BLEND_DST_RGB, gl.BLEND_SRC_ALPHA, gl.BLEND_DST_ALPHA,
    gl.BLEND_EQUATION_RGB, gl.BLEND_EQUATION_ALPHA,
  ].map((name) => gl.getParameter(name) as number) as [
    number, number, number, number, number, number];
  return () => {
    kSwitches.forEach((name, k) => {
      if (switches[k]) gl.enable(gl[name]);
      else gl.disable(gl[name]);
    });
    gl.depthMask(writesDepth);
    gl.colorMask(...writesColour);
    gl.depthFunc(compares);
    gl.viewport(viewport[0] as number, viewport[1] as number, viewport[2] as number,
                viewport[3] as number);
    gl.blendFuncSeparate(sourceColour, toColour, sourceAlpha, toAlpha);
    gl.blendEquationSeparate(colour, alpha);
  };
}

/** Sets the state in which splats are drawn among objects: tested by depth, without writing it. */
export function drawAmongObjects(gl: WebGL2RenderingContext, isReversed: boolean): void {
  for (const name of kSwitches) gl.disable(gl[name]);
  gl.enable(gl.DEPTH_TEST);
  gl.depthFunc(isReversed ? gl.GEQUAL : gl.LEQUAL);
  gl.depthMask(false);
  gl.colorMask(true, true, true, true);
  gl.blendEquation(gl.FUNC_ADD);
}
