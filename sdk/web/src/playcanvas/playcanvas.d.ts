// SPDX-License-Identifier: Apache-2.0
// The part of PlayCanvas that the adapter uses, so that the package builds without it. Applications
// have the declarations of PlayCanvas instead.
declare module "playcanvas" {
  export class Vec3 {
    constructor(x: number, y: number, z: number);
    length(): number;
  }
  export class Mat4 {
    readonly data: Float32Array;
  }
  export class BoundingBox {
    constructor(centre?: Vec3, halfExtents?: Vec3);
    center: Vec3;
    halfExtents: Vec3;
    setMinMax(min: Vec3, max: Vec3): void;
    setFromTransformedAabb(aabb: BoundingBox, matrix: Mat4): void;
  }
  export class BoundingSphere {
    constructor(centre: Vec3, radius: number);
  }
  export class EventHandler {
    on(name: string, callback: (...values: any[]) => void, scope?: object): EventHandle;
    once(name: string, callback: (...values: any[]) => void, scope?: object): EventHandle;
    fire(name: string): this;
  }
  export class EventHandle {
    off(): void;
  }
  export class Entity extends EventHandler {
    getWorldTransform(): Mat4;
  }
  export class CameraComponent {
    readonly frustum: { containsSphere(sphere: BoundingSphere): number };
    readonly gammaCorrection: number;
    readonly nearClip: number;
    readonly projectionMatrix: Mat4;
    readonly renderTarget: { readonly flipY: boolean } | null;
    readonly viewMatrix: Mat4;
  }
  export class Layer {
    readonly id: number;
  }
  export class AppBase {
    readonly graphicsDevice: object;
    readonly scene: EventHandler;
    renderNextFrame: boolean;
  }
  export class Script extends EventHandler {
    static scriptName: string;
    app: AppBase;
    entity: Entity;
    enabled: boolean;
    initialize?(): void;
  }
  export const GAMMA_NONE: number;
  export const LAYERID_WORLD: number;
}
