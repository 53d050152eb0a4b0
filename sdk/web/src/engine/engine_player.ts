// SPDX-License-Identifier: Apache-2.0
// A scene that is drawn inside the frames of a 3D engine.
import { textOf } from "../player/errors";
import { SegmentPlayer, SegmentPlayerOptions } from "../player/segment_player";
import { sorterUrl } from "../resources";
import type { SceneInfo } from "../types";
import { cameraOfMatrices, product } from "../webgl2/camera";
import { SplatScene } from "../webgl2/splat_scene";
import type { EngineView } from "./engine_view";
import { drawAmongObjects, preserveState } from "./gl_state";

/** The corners of the scene's bounds with a margin, since primitives move and have a size. */
export function boundsOf(info: SceneInfo): { min: number[]; max: number[] } {
  const margin = 0.1 * Math.hypot(...info.boundsMax.map((max, k) => max - (info.boundsMin[k] ?? 0)));
  return {
    min: info.boundsMin.map((value) => value - margin),
    max: info.boundsMax.map((value) => value + margin),
  };
}

/** Plays a scene and draws it into the framebuffer that the engine has bound. */
export class EnginePlayer extends SegmentPlayer {
  private readonly splats: SplatScene;

  /** `onChange`: the image may have changed, so an engine that draws on demand has to draw. */
  constructor(
    private readonly gl: WebGL2RenderingContext, options: SegmentPlayerOptions, onChange: () => void,
  ) {
    const splats = new SplatScene(gl, {
      sorterUrl: sorterUrl(),
      restoresContext: true,
      report: (error) => this.fail(error),
      onOrder: () => this.announce(),
      guard: (work) => preserveState(gl, work),
    });
    super(splats, options, onChange);
    this.splats = splats;
    gl.canvas.addEventListener("webglcontextlost", this.onLost);
    gl.canvas.addEventListener("webglcontextrestored", this.onRestored);
  }

  /**
   * Draws the current time as the engine draws a transparent object. Restores the state of GL.
   * Throws an Error if the projection is no perspective.
   */
  draw(view: EngineView): void {
    if (view.projection[15] !== 0) throw new Error("scenes need a perspective camera");
    const ticks = this.gl.isContextLost() ? null : this.frameTicks();
    if (ticks === null) return;
    const { gl, splats } = this;
    const [left, bottom, width, height] = gl.getParameter(gl.VIEWPORT) as unknown as [
      number, number, number, number];
    const viewFromScene = product(view.viewFromWorld, view.worldFromScene);
    const camera = cameraOfMatrices(view.projection, viewFromScene, width, height, view.near);
    const target: WebGLFramebuffer | null = gl.getParameter(gl.DRAW_FRAMEBUFFER_BINDING);
    const bind = () => {
      gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, target);
      gl.viewport(left, bottom, width, height);
    };
    preserveState(gl, () => {
      drawAmongObjects(gl, view.isReversed);
      splats.draw(camera, ticks, {
        bind, left, top: bottom + height, depth: depthMapping(view), isLinear: view.isLinear,
      });
    });
    splats.follow(camera, ticks);
  }

  override destroy(): void {
    if (this.isDestroyed) return;
    this.gl.canvas.removeEventListener("webglcontextlost", this.onLost);
    this.gl.canvas.removeEventListener("webglcontextrestored", this.onRestored);
    super.destroy();
  }

  private readonly onLost = (event: Event): void => {
    event.preventDefault(); // so that the context is restored
    this.splats.lose();
  };

  private readonly onRestored = (): void => {
    try {
      this.splats.restore();
    } catch (error) {
      this.fail(error);
    }
    this.announce();
  };

  private fail(error: unknown): void {
    this.playback.fail("unsupported", `rendering failed: ${textOf(error)}`);
  }
}

/** The depth in NDC of a point at z in front of the camera, as SplatOutput states it. */
function depthMapping({ projection, logarithmicFar }: EngineView): [number, number, number] {
  if (logarithmicFar !== null) return [-1, 0, 2 / Math.log2(logarithmicFar + 1)];
  return [-(projection[10] as number), projection[14] as number, 0];
}
