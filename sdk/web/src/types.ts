// SPDX-License-Identifier: Apache-2.0
/**
 * A pinhole camera. World to camera: p_c = R p_w + t. OpenCV axes: x right, y down, z forward.
 * Pixel (i, j) covers [i, i+1) x [j, j+1).
 */
export interface Camera {
  rotation: number[];     // 9, row by row, world to camera
  translation: number[];  // 3, scene units
  fx: number; fy: number; cx: number; cy: number;  // pixels
  width: number; height: number;                   // pixels
  near: number;                                    // scene units; nearer primitives are not drawn
}
/** The description of an open scene. */
export interface SceneInfo {
  title: string;            // "" if the file states none
  duration: number;         // seconds
  tickSeconds: number;      // seconds per tick of the time base
  frames: number;           // ticks
  shDegree: number;         // 0..3
  primitives: number;
  kernel: number;           // of the splats, as the format defines it: 1, band-limited; 0, as in 3DGS
  boundsMin: number[]; boundsMax: number[];  // 3, scene units
  up: number[] | null;      // 3, unit vector against gravity; null: unknown
  metresPerUnit: number | null;  // > 0; null: unknown
  floor: number[] | null;   // 3, a point of the floor, scene units; null: unknown
  background: number[];     // 3, encoded as the colours
  startCamera: Camera | null;
  /**
   * The maximum number of primitives at one time in the first tier, in the first two tiers, and so on, as
   * far as known when the scene is opened.
   */
  tierPrimitives: number[];
  audio: SceneAudio | null; // null: the file names none
}
/** The sound that a file names. */
export interface SceneAudio {
  /** A URI reference, as the file states it. */
  location: string;
  /** The time of its first sample, seconds; may be before or after the timeline. */
  begin: number;
  /** URL of the file, after redirects, to which the location is relative; "" if the file is a Blob. */
  base: string;
}
/** A decoded segment, packed as player/src/packed_segment.h states, ready for the GPU. */
export interface PackedSegment {
  id: number;               // of the segment; replaces an earlier version with this id
  primitives: number;       // N; arrays have padded(N) = ceil(N / 256) * 256 entries
  shDegree: number;         // of the arrays
  begin: number; end: number;  // ticks of the timeline at which it is needed; end inclusive
  origin: number;           // ticks of the timeline from which its times count: local = ticks - origin
  words: ArrayBuffer;       // ownership passes to the receiver
}
/** Playback relative to the end of a recording in progress. Times are in seconds. */
export interface LiveState {
  following: boolean;     // playback follows the live edge, the end of the recorded data
  latency: number;        // from the position to the live edge
  targetLatency: number;  // the latency that playback converges to
}
/**
 * Problems that do not end playback: `retry`, a read failed and is repeated; `read-failed`, data could not be read and is
 * requested again later; `damaged`, the image lacks corrupt data; `stalled`, a recording in progress no longer grows.
 */
export type ProblemKind = "retry" | "read-failed" | "damaged" | "stalled";
/** `detail` of a `notice` event: a problem that does not end playback, also of the sound or the renderer. */
export interface PlayerNotice { kind: ProblemKind | "audio" | "renderer"; message: string }
/** Messages of the core worker to the page. */
export type CoreMessage =
  | { type: "opened"; info: SceneInfo }
  | { type: "segment"; segment: PackedSegment }
  | { type: "dropped"; id: number }
  | { type: "state"; state: "playing" | "paused" | "buffering" | "ended"; seconds: number; seek: number /* id of the last seek that came before; 0: none */; at: number /* performance.timeOrigin + performance.now() of the worker when seconds was true */;
      rate: number; buffered: [number, number][]; layers: number; layerCount: number;
      bytes: number /* fetched */; bytesPerSecond: number /* recent; 0: not known yet */; memory: number /* bytes of the budget in use */; duration: number;
      live: LiveState | null /* null: the file is complete */; tierPrimitives: number[] /* as in SceneInfo, as far as known now */ }
  | { type: "problem"; kind: ProblemKind; message: string }
  | { type: "error"; code: "network" | "format" | "unsupported" | "memory" | "usage" | "aborted"; message: string };
/** Messages of the page to the core worker. */
export type PageMessage =
  | { type: "open"; source: string | Blob; options: OpenOptions }
  | { type: "play" } | { type: "pause" } | { type: "seek"; seconds: number; id: number /* ascending */ } | { type: "rate"; rate: number }
  | { type: "loop"; loop: boolean } | { type: "latency"; seconds: number } | { type: "maxPrimitives"; primitives: number } | { type: "close" };
/** Limits of a source. */
export interface OpenOptions {
  memoryBudget: number;  // bytes of fetched and decoded data
  maxPrimitives: number; // at one time; tiers beyond it are not fetched; may be Infinity
  lookAhead: number;     // seconds
  latency: number;       // minimum seconds behind the live edge of a recording
}
/** The first bytes of a file, its size, the validator of its version ("": unknown), and its URL after redirects ("": none). */
export interface FileStart { head: Uint8Array; size: number; version: string; url: string }
/** The reason for a failed read that is not retried. */
export interface ReadFailure { problem: string; code: "network" | "unsupported" }
/** Results of the work that the page does while its worker starts. */
export type StartMessage =
  | { type: "core"; module: WebAssembly.Module } | { type: "core"; problem: string }  // stgs-core.wasm, compiled
  | { type: "expect"; source: string }  // the source that is opened next: the page reads its start, which follows
  | { type: "start"; start: FileStart | ReadFailure | null };  // null: the worker must read it
/** Statistics of a recent frame. */
export interface RendererStatistics {
  primitives: number;  // of all segments that were added
  /**
   * WebGPU: the splats of a recent frame after culling. WebGL2, which culls later: the primitives of the current order,
   * which are active at its time or, during playback, become active soon.
   */
  visible: number;
  sortMs: number;
  /** The format in which WebGL2 blends: rgba8, which shows bands of colour, if the GPU cannot blend rgba16f. */
  targetFormat?: "rgba16f" | "rgba8";
  /**
   * Milliseconds on the GPU: of evaluation, culling, projection, SH and sort together, and of
   * rasterisation. Only of a WebGPU renderer whose device has timestamps; browsers round them.
   */
  computeMs?: number;
  rasterMs?: number;
  /** Number of frames that the GPU has finished; absent: all drawn frames count as finished. */
  frames?: number;
}
/** Takes the segments of a scene. */
export interface SegmentSink {
  /** Begins another scene: removes all segments. */
  setScene(info: SceneInfo): void;
  addSegment(segment: PackedSegment): void;
  removeSegment(id: number): void;
  readonly statistics: RendererStatistics;
  /** Maximum number of primitives at one time, from the limits of the GPU; absent if unknown. */
  readonly maxPrimitives?: number;
  destroy(): void;
}
/** Draws segments. One canvas, one context of WebGL2 or WebGPU. */
export interface Renderer extends SegmentSink {
  /** Which renderer it is; null while it is being loaded. */
  readonly name: "webgl2" | "webgpu" | null;
  /** Receives failures that no call can report. The owner sets it; default: console.error. */
  onError: (error: Error) => void;
  /**
   * Draws the primitives at `ticks` of the timeline. The canvas takes the size of the camera. Where ordering by depth is done by a worker, a
   * frame uses the newest order that has arrived. Throws an Error after a failure.
   */
  render(camera: Camera, ticks: number): void;
  /**
   * Resolves once a frame has been drawn in the order of exactly this camera and time; for
   * screenshots and tests.
   */
  renderExactly(camera: Camera, ticks: number): Promise<void>;
  /**
   * Reads the last frame: premultiplied linear values as blended, RGBA floats, row by row from the
   * top. Rejects after a failure.
   */
  readPixels(): Promise<Float32Array>;
  /** Why it cannot draw; null or absent: it can, or is being loaded. */
  readonly failure?: Error | null;
  /** The renderer of views, if it is ready and can draw them. */
  readonly views: ViewRenderer | null;
  /** Resolves once `views` is known, whatever it is; absent: it is. */
  readonly whenReady?: Promise<void>;
}
/** A camera, and where its image is in a framebuffer, pixels from the lower left corner. */
export interface RenderView {
  camera: Camera;
  x: number;
  y: number;
  /**
   * Receives the mean depth of the splats along the axis of the camera, scene units, at most 65504; 0
   * where there are none. A texture in R32F of the size of the image, rows from the bottom. Only if the
   * renderer was created with `depth`.
   */
  depth?: WebGLTexture;
}
/** Draws several views of one frame, as the eyes of a headset. */
export interface ViewRenderer {
  readonly context: WebGL2RenderingContext;
  /**
   * Draws the views at `ticks` of the timeline into a framebuffer of the context; null: that of the
   * canvas. Views with parallel axes have one order of depth, others one each. With `isClear`, alpha
   * is that of the splats; otherwise the background of the scene is behind them. Throws an Error if
   * the renderer cannot write the depth of a view.
   */
  renderViews(
    to: WebGLFramebuffer | null, views: readonly RenderView[], ticks: number, isClear: boolean,
  ): void;
}
