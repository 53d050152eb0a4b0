// SPDX-License-Identifier: Apache-2.0
// The part of three.js that the adapter uses, so that the package builds without it. Applications
// have the declarations of three.js instead.
declare module "three" {
  export interface Matrix4 {
    readonly elements: number[];
  }
  export class Vector3 {
    constructor(x: number, y: number, z: number);
  }
  export class Box3 {
    constructor(min: Vector3, max: Vector3);
    getBoundingSphere(sphere: Sphere): Sphere;
  }
  export class Sphere {
    constructor(centre?: Vector3, radius?: number);
  }
  export class BufferAttribute {
    constructor(array: Float32Array, itemSize: number);
  }
  export class BufferGeometry {
    boundingBox: Box3 | null;
    boundingSphere: Sphere | null;
    setAttribute(name: string, attribute: BufferAttribute): this;
    setDrawRange(start: number, count: number): void;
    dispose(): void;
  }
  export class Material {
    dispose(): void;
  }
  export class MeshBasicMaterial extends Material {
    constructor(parameters: { transparent: boolean; depthWrite: boolean });
  }
  export class Object3D {
    readonly matrixWorld: Matrix4;
    dispatchEvent(event: { type: string }): void;
  }
  export class Mesh extends Object3D {
    constructor(geometry: BufferGeometry, material: Material);
    geometry: BufferGeometry;
    material: Material;
    onBeforeRender(renderer: WebGLRenderer, scene: Scene, camera: Camera,
                   geometry: BufferGeometry, material: Material): void;
  }
  export class Camera extends Object3D {
    readonly projectionMatrix: Matrix4;
    readonly matrixWorldInverse: Matrix4;
  }
  export class PerspectiveCamera extends Camera {
    readonly near: number;
    readonly far: number;
    readonly reversedDepth?: boolean;
    readonly isArrayCamera?: boolean;
  }
  export class Scene extends Object3D {
    readonly overrideMaterial: Material | null;
  }
  export interface WebGLRenderTarget {
    readonly isXRRenderTarget?: boolean;
    readonly texture: { readonly colorSpace: string };
  }
  export class WebGLRenderer {
    readonly isWebGLRenderer?: boolean;
    readonly outputColorSpace: string;
    readonly capabilities: { readonly logarithmicDepthBuffer: boolean };
    getContext(): WebGLRenderingContext | WebGL2RenderingContext;
    getRenderTarget(): WebGLRenderTarget | null;
  }
  export const ColorManagement: { readonly enabled: boolean; readonly workingColorSpace: string };
  export const LinearSRGBColorSpace: string;
  export const REVISION: string;
  export const SRGBColorSpace: string;
}
