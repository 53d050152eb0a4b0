// SPDX-License-Identifier: Apache-2.0
// The attributes of <stgs-player> whose properties only reflect them.
import { DEVICES, QUALITIES } from "../player/adaptation";
import type { Quality } from "../player/adaptation";
import type { DeviceClass } from "../player/device";
import { checkLatency, DEFAULT_LATENCY, isLatency } from "../player/latency";
import type { RendererChoice } from "../renderer_choice";

// The module can be imported without a DOM, such as on a server.
const Base = typeof HTMLElement === "undefined" ? (class {} as typeof HTMLElement) : HTMLElement;

/** An element with these attributes. Unknown values have the effect of the default. */
export abstract class ReflectedElement extends Base {
  get poster(): string {
    return this.getAttribute("poster") ?? "";
  }
  set poster(url: string) {
    this.setAttribute("poster", url);
  }
  /** Default "orbit". */
  get camera(): "orbit" | "fly" {
    return this.oneOf("camera", ["fly"]) ?? "orbit";
  }
  set camera(camera: "orbit" | "fly") {
    this.setAttribute("camera", camera);
  }
  /** The renderer with which the player is created; default "auto". */
  get renderer(): RendererChoice {
    return this.oneOf("renderer", ["webgpu", "webgl2"]) ?? "auto";
  }
  set renderer(renderer: RendererChoice) {
    this.setAttribute("renderer", renderer);
  }
  /** The amount of data fetched and drawn; default "auto". */
  get quality(): Quality {
    return this.oneOf("quality", QUALITIES) ?? "auto";
  }
  set quality(quality: Quality) {
    this.setAttribute("quality", quality);
  }
  /** The class of device whose budgets apply; null: it is detected. */
  get device(): DeviceClass | null {
    return this.oneOf("device", DEVICES);
  }
  set device(device: DeviceClass | null) {
    if (device === null) this.removeAttribute("device");
    else this.setAttribute("device", device);
  }
  /** The sound: "auto" (default), "none", or a URL relative to the page; see `StgsPlayer.audio`. */
  get audio(): string {
    return this.getAttribute("audio") || "auto";
  }
  set audio(source: string) {
    this.setAttribute("audio", source);
  }
  /** See `StgsPlayer.latency`. The attribute is a number of seconds, 0 to 3600. */
  get latency(): number {
    const text = this.getAttribute("latency") ?? "";
    const seconds = text.trim() === "" ? NaN : Number(text);
    return isLatency(seconds) ? seconds : DEFAULT_LATENCY;
  }
  set latency(seconds: number) {
    this.setAttribute("latency", `${checkLatency(seconds)}`);
  }
  /** The settings of a player that take effect at any time. */
  protected get settings(): { quality: Quality; audio: string; latency: number } {
    const { quality, audio, latency } = this;
    return { quality, audio, latency };
  }
  get controls(): boolean {
    return this.hasAttribute("controls");
  }
  set controls(controls: boolean) {
    this.toggleAttribute("controls", controls);
  }
  get autoplay(): boolean {
    return this.hasAttribute("autoplay");
  }
  set autoplay(autoplay: boolean) {
    this.toggleAttribute("autoplay", autoplay);
  }
  get loop(): boolean {
    return this.hasAttribute("loop");
  }
  set loop(loop: boolean) {
    this.toggleAttribute("loop", loop);
  }
  get free(): boolean {
    return this.hasAttribute("free");
  }
  set free(free: boolean) {
    this.toggleAttribute("free", free);
  }

  private oneOf<T extends string>(name: string, values: readonly T[]): T | null {
    const value = this.getAttribute(name);
    return values.find((one) => one === value) ?? null;
  }
}
