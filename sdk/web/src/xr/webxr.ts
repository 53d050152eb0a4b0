// SPDX-License-Identifier: Apache-2.0
// The part of WebXR that the player uses; TypeScript 4.8 does not declare it.

export interface XrRigidTransform {
  readonly matrix: Float32Array; // column by column
  readonly inverse: XrRigidTransform;
}

export interface XrView {
  readonly projectionMatrix: Float32Array;
  readonly transform: XrRigidTransform;
}

export interface XrFrame {
  /** Null while the device does not know its pose. */
  getViewerPose(space: object): { readonly views: readonly XrView[] } | null;
}

export interface XrLayer {
  /** Null: that of the canvas. */
  readonly framebuffer: WebGLFramebuffer | null;
  getViewport(view: XrView): { x: number; y: number; width: number; height: number } | null;
}

export interface XrSession extends EventTarget {
  readonly renderState: { readonly baseLayer: XrLayer | null; readonly depthNear: number };
  requestAnimationFrame(callback: (time: number, frame: XrFrame) => void): number;
  requestReferenceSpace(type: "local-floor" | "local"): Promise<object>;
  updateRenderState(state: { baseLayer: XrLayer }): void;
  end(): Promise<void>;
}

export interface XrSystem {
  isSessionSupported(mode: string): Promise<boolean>;
  requestSession(mode: string, init: { optionalFeatures: string[] }): Promise<XrSession>;
}

type LayerInit = { antialias: boolean; depth: boolean; stencil: boolean; alpha: boolean };

/** The WebXR of the page; null if the browser has none. */
export function xrSystem(): XrSystem | null {
  if (typeof navigator === "undefined") return null;
  return (navigator as { xr?: XrSystem }).xr ?? null;
}

/** Ends a session that has not dispatched `end`. Resolves once it has, also if it was ending already. */
export function endSession(session: XrSession): Promise<void> {
  return new Promise((resolve) => {
    session.addEventListener("end", () => resolve(), { once: true });
    session.end().catch(() => undefined); // it is ending already
  });
}

/** Creates the layer of a session on a context that is compatible with its device. */
export function createLayer(session: XrSession, context: WebGL2RenderingContext): XrLayer {
  const { XRWebGLLayer: Layer } = globalThis as unknown as {
    XRWebGLLayer: new (session: XrSession, context: object, init: LayerInit) => XrLayer;
  };
  return new Layer(session, context, {
    antialias: false, depth: false, stencil: false, alpha: true,
  });
}

/** Makes a context compatible with the device of sessions. */
export function makeCompatible(context: WebGL2RenderingContext): Promise<void> {
  return (context as unknown as { makeXRCompatible(): Promise<void> }).makeXRCompatible();
}
