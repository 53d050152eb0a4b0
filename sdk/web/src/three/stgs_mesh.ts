// SPDX-License-Identifier: Apache-2.0
import {
  Box3, BufferAttribute, BufferGeometry, Camera, LinearSRGBColorSpace, Material, Mesh,
  MeshBasicMaterial, PerspectiveCamera, Scene, Sphere, Vector3, WebGLRenderer,
} from "three";
import { boundsOf, EnginePlayer } from "../engine/engine_player";
import { SegmentPlayerOptions } from "../player/segment_player";

export interface StgsMeshOptions extends SegmentPlayerOptions {
  /** Draws the mesh; other renderers cannot. */
  renderer: WebGLRenderer;
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
  /** Plays the scene, like a media element. */
  readonly player: EnginePlayer;

  /** Throws an Error if the renderer is no WebGLRenderer. */
  constructor({ renderer, ...options }: StgsMeshOptions) {
    // Lists the object among the transparent ones; nothing of the geometry is drawn.
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(3), 3));
    geometry.setDrawRange(0, 0);
    super(geometry, new MeshBasicMaterial({ transparent: true, depthWrite: false }));
    const gl = renderer.isWebGLRenderer ? renderer.getContext() : null;
    if (!(gl instanceof WebGL2RenderingContext)) {
      throw new Error("StgsMesh needs a WebGLRenderer of three.js; WebGPURenderer is not supported");
    }
    this.player = new EnginePlayer(gl, options, () => this.dispatchEvent({ type: "change" }));
    this.player.addEventListener("loadedmetadata", () => this.applyBounds());
    this.applyBounds();
  }

  override onBeforeRender(
    renderer: WebGLRenderer, _scene: Scene, camera: Camera, _geometry: BufferGeometry,
    material: Material,
  ): void {
    if (material !== this.material) return; // of a pass for normals or depths
    const perspective = camera as PerspectiveCamera;
    const target = renderer.getRenderTarget();
    let colourSpace = renderer.outputColorSpace;
    if (target !== null) {
      colourSpace = target.isXRRenderTarget ? target.texture.colorSpace : LinearSRGBColorSpace;
    }
    this.player.draw({
      projection: camera.projectionMatrix.elements,
      viewFromWorld: camera.matrixWorldInverse.elements,
      worldFromScene: this.matrixWorld.elements,
      near: perspective.near,
      logarithmicFar: renderer.capabilities.logarithmicDepthBuffer ? perspective.far : null,
      isReversed: perspective.reversedDepth === true,
      isLinear: colourSpace === LinearSRGBColorSpace,
    });
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
