// SPDX-License-Identifier: Apache-2.0
// WebXR for node: sessions that draw nothing and begin when the test decides.

export class FakeSession extends EventTarget {
  ended = false;
  renderState = { baseLayer: null, depthNear: 0.1 };
  requestAnimationFrame() {
    return 1;
  }
  async requestReferenceSpace() {
    return {};
  }
  updateRenderState() {}
  async end() {
    this.ended = true;
    this.dispatchEvent(new Event("end"));
  }
}

/** Sets the globals. Returns the requests of sessions, `{ resolve, reject }` in order, and a function that restores the globals. */
export function fakeXr() {
  const requests = [];
  const xr = {
    requestSession: () => new Promise((resolve, reject) => requests.push({ resolve, reject })),
    isSessionSupported: async () => true,
  };
  const setNavigator = (value) => Object.defineProperty(globalThis, "navigator", { value, configurable: true, writable: true });
  const { navigator } = globalThis;
  setNavigator({ xr });
  globalThis.XRWebGLLayer = class {};
  return { requests, restore: () => setNavigator(navigator) };
}

/** The `views` of a renderer. */
export function fakeViews() {
  const context = { canvas: new EventTarget(), makeXRCompatible: async () => undefined, isContextLost: () => false };
  return { context, renderViews: () => undefined };
}
