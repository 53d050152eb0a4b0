// SPDX-License-Identifier: Apache-2.0
import {
  Box3, BufferAttribute, BufferGeometry, Camera, Material, Mesh, MeshBasicMaterial, Scene, Sphere,
  Vector3, WebGLRenderer,
} from "three";
import { boundsOf } from "../engine/engine_player";
import type { EnginePlayer } from "../engine/engine_player";
import type { GpuEnginePlayer } from "../engine/gpu_engine_player";
import type { SegmentPlayerOptions } from "../player/segment_player";
import type { ThreeGpuRenderer } from "./backend";
import { drawingOf } from "./drawing";
import type { Drawing } from "./drawing";

/** Settings of a `StgsMesh`. */
export interface StgsMeshOptions extends SegmentPlayerOptions {
  /**
   * The only renderer that can draw the mesh. Await `init()` of a WebGPURenderer first.
   */
  renderer: WebGLRenderer | ThreeGpuRenderer;
}

/**
 * A scene of 4D Gaussians as an object of three.js. Scene units are those of its parent, and its
 * axes those of the file; rotate or scale it like any object.
 *
 * It is drawn with the transparent objects: objects in front of a splat's centre hide the splat,
 * and splats blend over objects behind them. It writes no depth. Materials, lights, fog and
 * shadows do not affect it. An event `change` reports that it has to be drawn again.
 */
export class StgsMesh extends Mesh {
  private readonly drawing: Drawing;

  /**
   * Throws an Error if the renderer is neither a WebGLRenderer nor a WebGPURenderer, or if a WebGPURenderer
   * is not initialized.
   */
  constructor({ renderer, ...options }: StgsMeshOptions) {
    // Lists the object among the transparent ones; nothing of the geometry is drawn.
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(3), 3));
    geometry.setDrawRange(0, 0);
    super(geometry, new MeshBasicMaterial({ transparent: true, depthWrite: false }));
    this.drawing = drawingOf(renderer, options, () => this.dispatchEvent({ type: "change" }));
    this.player.addEventListener("loadedmetadata", () => this.applyBounds());
    this.applyBounds();
  }

  /** Plays the scene, like a media element. */
  get player(): EnginePlayer | GpuEnginePlayer {
    return this.drawing.player;
  }

  override onBeforeRender(
    renderer: WebGLRenderer, scene: Scene, camera: Camera, _geometry: BufferGeometry,
    material: Material,
  ): void {
    // Not in passes for normals, depths or shadows.
    if (material !== this.material || scene.overrideMaterial) return;
    this.drawing.draw(renderer, camera, this.matrixWorld);
  }

  /** Ends the player and frees the objects of the GPU. Remove the mesh from its parent as well. */
  dispose(): void {
    this.player.destroy();
    this.geometry.dispose();
    this.material.dispose();
  }

  private applyBounds(): void {
    const { info } = this.player;
    const { min, max } = info === null ? { min: [0, 0, 0], max: [0, 0, 0] } : boundsOf(info);
    const corner = ([x, y, z]: number[]) => new Vector3(x ?? 0, y ?? 0, z ?? 0);
    this.geometry.boundingBox = new Box3(corner(min), corner(max));
    this.geometry.boundingSphere = this.geometry.boundingBox.getBoundingSphere(new Sphere());
  }
}
