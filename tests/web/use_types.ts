// SPDX-License-Identifier: Apache-2.0
// A program that uses the types of the package: it has to compile.
import { createPlayer, createWorker, defineStgsPlayer, PlayerError, SegmentPlayer, StgsPlayer } from "stgs";
import type {
  BufferedRanges, Camera, CameraSource, ErrorReason, Host, LiveState, PlayerNotice, QualityReport, Renderer, SceneInfo,
  StgsPlayerElement, StgsPlayerFactory, WorkerLike,
} from "stgs";
import { connect } from "stgs/bridge";
import { createWebGl2Renderer } from "stgs/webgl2";
import { createWebGpuRenderer } from "stgs/webgpu";
import type { SplatRenderer, SplatView } from "stgs/webgpu";

export async function play(canvas: HTMLCanvasElement, file: File): Promise<SceneInfo | null> {
  const player: StgsPlayer = createPlayer(canvas, { memoryBudget: 2 ** 28, lookAhead: 5, renderer: "webgpu", maxPrimitives: 1e6, audio: "none" });
  const isModern: boolean = player.activeRenderer === "webgpu";
  if (!isModern) console.log(player.stats.computeMs);
  await player.load(file, { signal: new AbortController().signal });
  player.currentTime = 0.5 * player.duration;
  await player.play();
  const live: LiveState | null = player.live;
  if (live?.following === false) player.goLive();
  return player.info;
}

export function drawEyes(splats: SplatRenderer, player: SegmentPlayer, eyes: SplatView[]): void {
  const cameras: Camera[] = eyes.map(({ camera }) => camera);
  const ticks = player.frameTicks();
  if (ticks !== null && cameras.length > 0) splats.drawViews(eyes, ticks, null);
}

export function drawWithDepth(canvas: HTMLCanvasElement, camera: Camera, ticks: number): void {
  const renderer = createWebGl2Renderer(canvas, { depth: true });
  const depth = renderer.context.createTexture();
  if (depth !== null) renderer.renderViews(null, [{ camera, x: 0, y: 0, depth }], ticks, true);
}

// @ts-expect-error: not a renderer
new SegmentPlayer({});

export async function control(frame: HTMLIFrameElement): Promise<number | null> {
  const remote = await connect(frame, { timeout: 1000 });
  await remote.set("quality", "low");
  // @ts-expect-error: cannot be set
  await remote.set("duration", 1);
  await remote.setCamera({ ...(await remote.camera()), azimuth: 0 });
  return remote.state?.duration ?? null;
}

export async function rendererOf(canvas: HTMLCanvasElement): Promise<Renderer> {
  return "gpu" in navigator ? createWebGpuRenderer(canvas) : createWebGl2Renderer(canvas);
}

export function watch(player: StgsPlayer | StgsPlayerElement): BufferedRanges {
  player.addEventListener("notice", (event) => {
    const { kind, message } = (event as CustomEvent<PlayerNotice>).detail;
    if (kind === "damaged") console.log(message);
    // @ts-expect-error: not a problem
    if (kind === "buffering") console.log(message);
  });
  const reason: ErrorReason | undefined = player.error?.reason;
  if (player.error?.code === PlayerError.MEDIA_ERR_NETWORK) console.log(reason);
  if (player.stats.targetFormat === "rgba8") console.log("blended in 8 bits");
  return player.buffered;
}

export function playWithParts(canvas: HTMLCanvasElement, renderer: Renderer, host: Host, source: CameraSource): void {
  const worker: WorkerLike = createWorker();
  new StgsPlayer({ canvas, renderer, host, worker }).cameraSource = source;
  const factory: StgsPlayerFactory = { createWorker, createRenderer: () => renderer };
  defineStgsPlayer(factory, "my-player");
}

const element = document.createElement("stgs-player");
element.src = "scene.stgs";
element.loop = true;
element.quality = "medium";
element.device = "headset";
element.muted = true;
element.addEventListener("qualitychange", (event) => {
  const { resolutionScale, reason } = (event as CustomEvent<QualityReport>).detail;
  console.log(resolutionScale, reason);
});
// @ts-expect-error: not a camera
element.camera = "walk";
// @ts-expect-error: not a quality
element.quality = "best";
// @ts-expect-error: not a renderer
element.renderer = "webgl1";
