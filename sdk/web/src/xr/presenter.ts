// SPDX-License-Identifier: Apache-2.0
// Shows the scene of a player in a headset.
import { abortError, unsupported } from "../player/errors";
import { FrameClient } from "../player/frame_loop";
import { Renderer, RenderView, SceneInfo, ViewRenderer } from "../types";
import { cameraOfMatrices, product } from "../webgl2/camera";
import { roomFromScene } from "./placement";
import { createLayer, endSession, makeCompatible, XrFrame, XrLayer, XrSession, XrSystem, xrSystem } from "./webxr";

/** What the headset shows: the scene alone, or the room behind it as well. */
export type XrMode = "immersive-vr" | "immersive-ar";

/** Settings of `StgsPlayer.enterXR`. */
export interface XrOptions {
  /** Metres per scene unit; default: that of the scene. */
  metresPerUnit?: number;
}

/** The owner of a presenter. */
export interface XrClient extends Pick<FrameClient, "onFrame" | "frameTime" | "onRenderError"> {
  info(): SceneInfo | null;
  /** A frame was drawn. */
  onDrawn(): void;
  /** The viewer pressed the main button of a controller, or pinched. */
  onSelect(): void;
  onStart(): void;
  onEnd(): void;
}

/** A session and the objects that it draws with. */
interface Presentation {
  session: XrSession;
  layer: XrLayer;
  space: object;
  room: number[]; // from the scene
  isClear: boolean; // the surroundings show behind the splats
}

/** A session that has not begun yet. */
interface Start {
  abort: AbortController;
  /** Resolves once the session has begun, or there is none. */
  done: Promise<void>;
}

/** Runs at most one session at a time. */
export class XrPresenter {
  private session: XrSession | null = null;
  private starting: Start | null = null; // of a session that has not begun yet
  private isDestroyed = false;

  constructor(private readonly renderer: Renderer, private readonly client: XrClient) {}

  get isActive(): boolean {
    return this.session !== null;
  }

  async supports(mode: XrMode): Promise<boolean> {
    await this.renderer.whenReady;
    if (this.renderer.views === null || this.renderer.failure) return false;
    try {
      return (await xrSystem()?.isSessionSupported(mode)) ?? false;
    } catch {
      return false; // the page may not use WebXR
    }
  }

  /** Begins a session; `StgsPlayer.enterXR` states when it rejects. */
  async enter(mode: XrMode, options: XrOptions): Promise<void> {
    const { views, name, failure } = this.renderer;
    const system = xrSystem();
    const info = this.client.info();
    if (system === null) {
      throw unsupported("this browser has no WebXR, or the page is not from https or localhost");
    }
    const busy = this.session !== null || this.starting !== null;
    if (info === null || busy) {
      const message = busy ? "a session is active or requested already; await exitXR first"
                           : "no scene is open; wait for loadedmetadata";
      throw new DOMException(message, "InvalidStateError");
    }
    if (failure) throw unsupported(`the renderer failed: ${failure.message}`);
    if (name === null) throw new DOMException("the renderer is being loaded; await supportsXR first", "InvalidStateError");
    if (views === null) throw unsupported("WebXR needs the WebGL2 renderer; choose renderer \"webgl2\"");
    const abort = new AbortController();
    const started = this.start(system, mode, views, info, options, abort.signal);
    this.starting = { abort, done: started.catch(() => undefined) };
    try {
      await started;
    } finally {
      this.starting = null;
    }
  }

  /**
   * Ends the session, also one that the browser has not begun yet. Resolves once there is none; while the browser asks
   * the user, after the answer.
   */
  async exit(): Promise<void> {
    if (this.starting !== null) {
      this.starting.abort.abort();
      await this.starting.done;
    }
    if (this.session !== null) await endSession(this.session);
  }

  destroy(): void {
    this.isDestroyed = true;
    this.exit();
  }

  /** Requests a session and begins it. Rejects with an `AbortError` after an abort. */
  private async start(
    system: XrSystem, mode: XrMode, renderer: ViewRenderer, info: SceneInfo, options: XrOptions, signal: AbortSignal,
  ): Promise<void> {
    try {
      // The first call, since it is allowed only during the handling of input.
      const session = await system.requestSession(mode, { optionalFeatures: ["local-floor"] });
      await this.present(session, renderer, info, mode === "immersive-ar", options, signal);
    } catch (error) {
      throw signal.aborted ? abortError("the session was ended before it began") : error;
    }
  }

  private async present(
    session: XrSession, renderer: ViewRenderer, info: SceneInfo, isClear: boolean,
    { metresPerUnit }: XrOptions, signal: AbortSignal,
  ): Promise<void> {
    let hasEnded = false;
    session.addEventListener("end", () => (hasEnded = true), { once: true });
    const check = () => {
      if (hasEnded || signal.aborted) throw abortError("the session has ended");
    };
    try {
      check();
      await makeCompatible(renderer.context);
      const { space, isOnFloor } = await referenceSpace(session);
      check();
      const layer = createLayer(session, renderer.context);
      session.updateRenderState({ baseLayer: layer });
      const room = roomFromScene(info, { metresPerUnit, isOnFloor });
      this.begin({ session, layer, space, room, isClear }, renderer);
    } catch (error) {
      if (!hasEnded) await endSession(session);
      throw error;
    }
  }

  private begin(presentation: Presentation, renderer: ViewRenderer): void {
    const { session } = presentation;
    const end = () => session.end().catch(() => undefined);
    const { canvas } = renderer.context;
    // The layer draws nothing any more once the context is lost.
    canvas.addEventListener("webglcontextlost", end);
    session.addEventListener("select", () => this.client.onSelect());
    session.addEventListener("end", () => {
      canvas.removeEventListener("webglcontextlost", end);
      this.session = null;
      if (!this.isDestroyed) this.client.onEnd();
    }, { once: true });
    this.session = session;
    this.client.onStart();
    const step = (_time: number, frame: XrFrame) => {
      if (this.session !== session || this.isDestroyed) return;
      session.requestAnimationFrame(step);
      this.draw(presentation, renderer, frame);
    };
    session.requestAnimationFrame(step);
  }

  private draw(presentation: Presentation, renderer: ViewRenderer, frame: XrFrame): void {
    const { client } = this;
    const now = performance.now();
    client.onFrame(now);
    const time = client.frameTime(now);
    const views = viewsOf(presentation, frame);
    if (time === null || views.length === 0) return;
    try {
      renderer.renderViews(presentation.layer.framebuffer, views, time.ticks, presentation.isClear);
    } catch (error) {
      client.onRenderError(error);
      return;
    }
    client.onDrawn();
  }
}

/** Returns a space with its origin on the floor where the device knows it, or at the eyes. */
async function referenceSpace(
  session: XrSession,
): Promise<{ space: object; isOnFloor: boolean }> {
  try {
    return { space: await session.requestReferenceSpace("local-floor"), isOnFloor: true };
  } catch {
    return { space: await session.requestReferenceSpace("local"), isOnFloor: false };
  }
}

/** Returns the cameras of a frame; none while the pose is unknown. */
function viewsOf({ session, layer, space, room }: Presentation, frame: XrFrame): RenderView[] {
  const near = session.renderState.depthNear;
  const views: RenderView[] = [];
  for (const view of frame.getViewerPose(space)?.views ?? []) {
    const viewport = layer.getViewport(view);
    if (viewport === null || viewport.width === 0 || viewport.height === 0) continue;
    const { x, y, width, height } = viewport;
    const viewFromScene = product(view.transform.inverse.matrix, room);
    const camera = cameraOfMatrices(view.projectionMatrix, viewFromScene, width, height, near);
    views.push({ camera, x, y });
  }
  return views;
}
