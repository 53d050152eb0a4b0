// SPDX-License-Identifier: Apache-2.0
// A scene that is drawn inside the frames of a 3D engine.
import { browserHost } from "../player/host";
import { ScenePlayer } from "../player/scene_player";
import { createWorker, sorterUrl } from "../resources";
import type { SceneInfo } from "../types";
import { cameraOfMatrices, product } from "../webgl2/camera";
import type { Matrix4 } from "../webgl2/camera";
import { SplatScene } from "../webgl2/splat_scene";
import { drawAmongObjects, preserveState } from "./gl_state";

/** Settings of a scene in an engine. */
export interface EngineOptions {
  /** URL of the scene, or a file. It is loaded at once. */
  src?: string | Blob;
  /** Plays as soon as data is available. */
  autoplay?: boolean;
  /** Repeats the clip. */
  loop?: boolean;
  /** Bytes for fetched and decoded data; default 512 MiB. */
  memoryBudget?: number;
  /** Seconds to fetch ahead; default 10. */
  lookAhead?: number;
}

/** How the engine draws the current image. */
export interface EngineView {
  /** Column by column, of OpenGL. It has to be a perspective. */
  projection: Matrix4;
  viewFromWorld: Matrix4;
  worldFromScene: Matrix4;
  /** Distance of the near plane. */
  near: number;
  /** Distance of the far plane if the depth buffer is logarithmic; otherwise null. */
  logarithmicFar: number | null;
  /** Whether nearer depths are larger. */
  isReversed: boolean;
  /** Whether the target has linear colours; otherwise they are sRGB-encoded. */
  isLinear: boolean;
}

/** The corners of the scene's bounds with a margin, since primitives move and have a size. */
export function boundsOf(info: SceneInfo): { min: number[]; max: number[] } {
  const margin = 0.1 * Math.hypot(...info.boundsMax.map((max, k) => max - (info.boundsMin[k] ?? 0)));
  return {
    min: info.boundsMin.map((value) => value - margin),
    max: info.boundsMax.map((value) => value + margin),
  };
}

/** Plays a scene and draws it into the framebuffer that the engine has bound. */
export class EnginePlayer extends ScenePlayer {
  private readonly splats: SplatScene;
  private announcement: number | null = null;
  private drawnTicks: number | null = null; // of the last frame

  /** `onChange`: the image may have changed, so an engine that draws on demand has to draw. */
  constructor(
    private readonly gl: WebGL2RenderingContext, options: EngineOptions,
    private readonly onChange: () => void,
  ) {
    const announce = () => this.announce();
    const splats = new SplatScene(gl, {
      sorterUrl: sorterUrl(),
      restoresContext: true,
      report: (error) => this.playback.fail("unsupported", `rendering failed: ${error.message}`),
      onOrder: announce,
      guard: (work) => preserveState(gl, work),
    });
    super({ worker: createWorker, ...options }, {
      sink: splats, host: browserHost(), onOpened: announce, onContent: announce,
      onTime: () => {
        if (this.playback.frameTime()?.ticks !== this.drawnTicks) announce();
      },
    });
    this.splats = splats;
    gl.canvas.addEventListener("webglcontextlost", this.onLost);
    gl.canvas.addEventListener("webglcontextrestored", this.onRestored);
    this.loop = options.loop ?? false;
    if (options.src === undefined) return;
    this.load(options.src).catch(() => undefined); // the error event reports it
    if (options.autoplay) this.play().catch(() => undefined);
  }

  /**
   * Draws the current time as the engine draws a transparent object. Restores the state of GL.
   * Throws an Error if the projection is no perspective.
   */
  draw(view: EngineView): void {
    if (view.projection[15] !== 0) throw new Error("scenes need a perspective camera");
    this.playback.updateTime(false);
    const time = this.playback.frameTime();
    if (time === null || this.isDestroyed || this.gl.isContextLost()) return;
    this.drawnTicks = time.ticks;
    const { gl, splats } = this;
    const [left, bottom, width, height] = gl.getParameter(gl.VIEWPORT) as unknown as [
      number, number, number, number];
    const viewFromScene = product(view.viewFromWorld, view.worldFromScene);
    const camera = cameraOfMatrices(view.projection, viewFromScene, width, height, view.near);
    preserveState(gl, () => {
      drawAmongObjects(gl, view.isReversed);
      splats.draw(camera, time.ticks, {
        left, top: bottom + height, depth: depthMapping(view), isLinear: view.isLinear,
      });
    });
    splats.follow(camera, time.ticks);
    if (time.running) this.announce();
  }

  override destroy(): void {
    if (this.isDestroyed) return;
    this.gl.canvas.removeEventListener("webglcontextlost", this.onLost);
    this.gl.canvas.removeEventListener("webglcontextrestored", this.onRestored);
    if (this.announcement !== null) cancelAnimationFrame(this.announcement);
    super.destroy();
  }

  /** Calls onChange() with the next frame of the page, so that it never runs within draw(). */
  private announce(): void {
    if (this.isDestroyed) return;
    this.announcement ??= requestAnimationFrame(() => {
      this.announcement = null;
      this.onChange();
    });
  }

  private readonly onLost = (event: Event): void => {
    event.preventDefault(); // so that the context is restored
    this.splats.lose();
  };

  private readonly onRestored = (): void => {
    this.splats.restore();
    this.announce();
  };
}

/** The depth in NDC of a point at z in front of the camera, as SplatOutput states it. */
function depthMapping({ projection, logarithmicFar }: EngineView): [number, number, number] {
  if (logarithmicFar !== null) return [-1, 0, 2 / Math.log2(logarithmicFar + 1)];
  return [-(projection[10] as number), projection[14] as number, 0];
}
