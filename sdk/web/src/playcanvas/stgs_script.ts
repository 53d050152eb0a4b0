// SPDX-License-Identifier: Apache-2.0
import {
  BoundingBox, BoundingSphere, CameraComponent, GAMMA_NONE, Layer, LAYERID_WORLD, Script, Vec3,
} from "playcanvas";
import { boundsOf, EnginePlayer } from "../engine/engine_player";

/**
 * A script that shows a scene of 4D Gaussians at its entity, in the units and axes of the file.
 *
 * Splats are drawn before the transparent objects of the layer World: objects in front of a splat's
 * centre hide the splat, and splats blend over objects behind them. It writes no depth. Materials,
 * lights, fog and shadows do not affect it. Its properties apply when the script is initialized.
 */
export class StgsScript extends Script {
  static override scriptName = "stgs";

  /** @attribute URL of the scene. */
  src = "";
  /** @attribute Plays as soon as data is available. */
  autoplay = false;
  /** @attribute Repeats the clip. */
  loop = false;
  /** Plays the scene, like a media element; null before the script is initialized. */
  player: EnginePlayer | null = null;
  private bounds: BoundingBox | null = null; // of the scene, in its own units

  /** Throws an Error if the graphics device is not one of WebGL2. */
  override initialize(): void {
    const { gl } = this.app.graphicsDevice as { gl?: unknown };
    if (!(gl instanceof WebGL2RenderingContext)) {
      throw new Error("StgsScript needs a graphics device of WebGL2; WebGPU is not supported: " +
        "create the device with deviceTypes: [DEVICETYPE_WEBGL2]");
    }
    const { src, autoplay, loop, app } = this;
    const player = new EnginePlayer(
      gl, src === "" ? { loop } : { src, autoplay, loop }, () => (app.renderNextFrame = true));
    this.player = player;
    player.addEventListener("loadedmetadata", () => this.applyBounds(player));
    const drawing = app.scene.on("prerender:layer", this.draw, this);
    this.once("destroy", () => {
      drawing.off();
      player.destroy();
    });
  }

  private draw(camera: CameraComponent, layer: Layer, isTransparent: boolean): void {
    const { player } = this;
    if (player === null || !this.enabled || layer.id !== LAYERID_WORLD || !isTransparent) return;
    if (!this.isInView(camera)) return;
    const projection = camera.projectionMatrix.data.slice();
    if (camera.renderTarget?.flipY) {
      for (const k of [1, 5, 9, 13]) projection[k] *= -1;
    }
    player.draw({
      projection,
      viewFromWorld: camera.viewMatrix.data,
      worldFromScene: this.entity.getWorldTransform().data,
      near: camera.nearClip,
      logarithmicFar: null,
      isReversed: false,
      isLinear: camera.gammaCorrection === GAMMA_NONE,
    });
  }

  private isInView(camera: CameraComponent): boolean {
    if (this.bounds === null) return false;
    const box = new BoundingBox();
    box.setFromTransformedAabb(this.bounds, this.entity.getWorldTransform());
    const sphere = new BoundingSphere(box.center, box.halfExtents.length());
    return camera.frustum.containsSphere(sphere) !== 0;
  }

  private applyBounds({ info }: EnginePlayer): void {
    if (info === null) return;
    const { min, max } = boundsOf(info);
    const corner = ([x, y, z]: number[]) => new Vec3(x ?? 0, y ?? 0, z ?? 0);
    this.bounds = new BoundingBox();
    this.bounds.setMinMax(corner(min), corner(max));
  }
}
