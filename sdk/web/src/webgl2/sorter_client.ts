// SPDX-License-Identifier: Apache-2.0
import { workerUrl } from "../worker_url";
import type { Order, SorterSegment, SortRequest } from "./sorter";
import type { SorterReply, SorterRequest } from "./sorter_messages";

/** Receives the replies of the worker. */
export interface SorterListener {
  /** The reply to the request. `order.buffer` belongs to the listener until recycle(). */
  onOrder(order: Order, milliseconds: number): void;
  /** The reply to requestWords(), once per segment. */
  onWords(key: number, words: ArrayBuffer): void;
  /** The worker cannot be started, or has failed. */
  onFailure(message: string): void;
}

/** The page's end of the sorter. Messages are processed in the order in which they are sent. */
export class SorterClient {
  private readonly worker: Worker;
  private spare: ArrayBuffer | null = null;
  private inFlight = false;

  /** Starts the worker. `url` is that of stgs-sorter.js. */
  constructor(url: string | URL, listener: SorterListener) {
    this.worker = new Worker(workerUrl(new URL(url, document.baseURI)), { type: "module", name: "stgs sorter" });
    this.worker.onmessage = ({ data }: MessageEvent<SorterReply>) => {
      if (data.type === "words") {
        listener.onWords(data.key, data.words);
        return;
      }
      this.inFlight = false;
      listener.onOrder(data.order, data.milliseconds);
    };
    this.worker.onerror = (event) => {
      event.preventDefault();
      const reason = event.message || "the script cannot be loaded";
      listener.onFailure(`the sorter ${String(url)} failed: ${reason}`);
    };
  }

  /** Whether the reply to a request has not arrived. */
  get isBusy(): boolean {
    return this.inFlight;
  }

  /** Adds a segment; its words are transferred. */
  add(segment: SorterSegment): void {
    this.post({ type: "add", segment }, [segment.words]);
  }

  remove(key: number): void {
    this.post({ type: "remove", key }, []);
  }

  /** Requests an order. Only one request may be in flight. */
  sort(request: SortRequest): void {
    const buffer = this.spare;
    this.spare = null;
    this.inFlight = true;
    this.post({ type: "sort", request, buffer }, buffer === null ? [] : [buffer]);
  }

  /** Requests copies of all words. */
  requestWords(): void {
    this.post({ type: "words" }, []);
  }

  /** Returns the buffer of an order that is no longer used. */
  recycle(buffer: ArrayBuffer): void {
    this.spare = buffer;
  }

  destroy(): void {
    this.worker.terminate();
  }

  private post(message: SorterRequest, transfer: Transferable[]): void {
    this.worker.postMessage(message, transfer);
  }
}
