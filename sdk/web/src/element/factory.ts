// SPDX-License-Identifier: Apache-2.0
import type { WorkerLike } from "../player/host";
import type { RendererChoice } from "../renderer_choice";
import type { Renderer } from "../types";

/** Creates the parts of a player. */
export interface StgsPlayerFactory {
  /** Called for each source before it is opened. The player terminates the worker. */
  createWorker(source: string | Blob): WorkerLike;
  /**
   * `choice`: the value of the attribute `renderer`. Throws if the browser cannot render; the message is
   * displayed. The player destroys the renderer.
   */
  createRenderer(canvas: HTMLCanvasElement, choice: RendererChoice): Renderer;
}
